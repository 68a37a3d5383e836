"""What ``benchmarks/compare.py`` runs on two builds: scripts that print one line of JSON.

A script uses only what both builds have, and imports it from whichever build PYTHONPATH names.
"""
