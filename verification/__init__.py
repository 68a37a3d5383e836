"""Rigs that prove the promises of the README; not installed with the wheel."""
