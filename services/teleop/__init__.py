"""Operators: keyboard, scripts, headset and a synthetic operator."""
