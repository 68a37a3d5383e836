"""What all tests share."""

import os

# MuJoCo reads it when it is first imported, by whichever test comes first.
os.environ.setdefault("MUJOCO_GL", "egl")
