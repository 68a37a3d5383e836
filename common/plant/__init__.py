"""Command guard, motor servo, fallback and limits that simulated and real plants share."""
