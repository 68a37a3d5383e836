"""The MuJoCo model of robot and scene, and what is read from it."""
