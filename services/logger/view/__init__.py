"""Opens logs in the Rerun viewer."""
