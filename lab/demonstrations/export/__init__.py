"""Collected demonstrations as data sets that other projects' loaders read."""
