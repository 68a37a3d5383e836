"""Demonstrations by the hundred: the synthetic operator's episodes as a data set."""
