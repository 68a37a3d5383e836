"""Targets of hands, grippers and neck, and set-points made of them."""
