"""The DRACO 3 humanoid: its MJCF, joints, motors, frames and workspace; rotations, kinematics."""
