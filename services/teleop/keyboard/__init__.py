"""The keyboard operator: a person at a terminal."""
