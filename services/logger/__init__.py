"""Records everything on the bus."""
