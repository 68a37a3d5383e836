"""Run a live system: the demo, keyboard driving, trials of a task."""
