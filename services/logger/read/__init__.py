"""Reads logs: messages, index, losses, episodes; damaged ones too."""
