"""Demonstrations: collecting them and exporting them."""
