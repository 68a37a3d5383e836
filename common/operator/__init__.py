"""What every operator of the robot shares, whether a person, a script or a policy."""
