"""Evaluates policies: trials of the scored tasks, tables, films of failures."""
