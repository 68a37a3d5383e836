"""What every service shares: schemas, topics, the bus, the runners and the robot as data."""
