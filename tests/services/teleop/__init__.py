"""Tests of the operator inputs."""
