"""Live runs: the demo, driving by keyboard, trials of a task."""
