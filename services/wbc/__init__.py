"""Whole-body control: from set-points and gait requests to joint commands."""
