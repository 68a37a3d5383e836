"""Fuzz every topic's decoder with random and damaged payloads."""
