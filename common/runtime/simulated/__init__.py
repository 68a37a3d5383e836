"""Runs services in one process on a virtual clock, bit-identical on repeat."""
