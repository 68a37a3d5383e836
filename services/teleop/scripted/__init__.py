"""An operator that plays a script."""
