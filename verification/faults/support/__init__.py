"""Processes that the fault plans run: probe services, traffic generator, tap reader, clock shim."""
