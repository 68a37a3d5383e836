"""Random and damaged payloads at every topic's decoder."""
