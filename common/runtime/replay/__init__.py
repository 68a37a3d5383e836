"""Runs a service again on the inputs that a log recorded."""
