"""Headset poses, triggers and buttons as operator."""
