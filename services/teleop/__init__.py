"""Operator inputs turned into set-points and gait requests."""
