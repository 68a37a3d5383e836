"""Fault injection: kill, stop, cut off or skew parts of a live system and judge the recovery."""
