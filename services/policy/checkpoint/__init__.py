"""Checkpoints: a folder with a manifest, a processor and a network's tensors."""
