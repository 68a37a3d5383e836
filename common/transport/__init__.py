"""Zenoh and nothing else: session, keys, publishers, raw tap and schema queries."""
