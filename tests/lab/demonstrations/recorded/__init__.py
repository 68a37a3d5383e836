"""Tests of episodes from logs."""
