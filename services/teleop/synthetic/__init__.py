"""The synthetic operator: does the tasks through the same device-level input as a person."""
