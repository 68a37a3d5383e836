"""What people do with the robot: run it, record it, study it."""
