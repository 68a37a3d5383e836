"""Off-screen rendering: the stereo pair, and pictures of runs, scenes and tasks."""
