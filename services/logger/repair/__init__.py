"""Makes damaged logs whole and verifies logs."""
