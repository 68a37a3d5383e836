"""What every plant shares, simulated or real: guard, servo, fallback and limits."""
