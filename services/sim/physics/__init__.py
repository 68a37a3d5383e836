"""The simulated plant: physics steps, start posture, sensor noise, pace."""
