"""How well the robot stands, walks and reaches: the figures the README quotes."""
