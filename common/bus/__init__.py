"""The typed bus: codec, Zenoh session, publishers, inboxes and delay lines."""
