"""The scripted operator: plays a script."""
