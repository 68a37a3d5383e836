"""From episodes and messages to what a network sees, and from its answers to set-points."""
