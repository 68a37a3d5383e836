"""Promises about standing, walking and reaching, measured in simulated time."""
