"""Injected delays, asked for against achieved: at consumers, live and in simulated time."""
