"""Starts and supervises the processes of a system; container images and compose files."""
