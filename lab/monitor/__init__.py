"""What people look at while a system runs: the live table, and what commands print."""
