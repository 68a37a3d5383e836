"""Zenoh and nothing else: session, keys, publishers, the raw tap and schema queries."""
