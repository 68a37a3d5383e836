"""A person at a terminal as operator."""
