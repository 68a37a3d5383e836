"""The DRACO 3 humanoid as data: one MJCF, joint and motor tables, frame names."""
