"""Policies that imitate demonstrations: configuration, networks, losses, processor, checkpoint.

``configuration``, ``processor``, ``checkpoint.manifest``, ``serving`` and ``service`` need numpy
and pydantic only, so that the robot's side runs without torch; ``networks``, ``kinds.network`` and
``checkpoint.folder`` need the extra ``policy``.
"""
