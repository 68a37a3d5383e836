"""Episodes from the logs of recorded runs."""
