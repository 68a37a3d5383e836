"""The service contract and the ways to run a service."""
