"""Runs a service as a process on Zenoh and the wall clock."""
