"""Watch a running system: the live table, and texts that commands print."""
