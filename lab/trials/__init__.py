"""Runs a task many times in simulated time."""
