"""Headset and hand controllers as the operator's input."""
