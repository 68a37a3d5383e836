"""Injected latency: link specifications, delay lines, and their control at run time."""
