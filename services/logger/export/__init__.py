"""Turns a log into an MCAP file that robotics viewers decode (``trill export``)."""
