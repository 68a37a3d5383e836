"""What is done with logs: marks, ledgers, replays, playing them back."""
