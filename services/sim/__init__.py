"""The plant: DRACO 3 in MuJoCo with its motor servo and command guard."""

import os

# MuJoCo would load a window library, which takes a tenth of the plant's start; no service opens a
# window, and pictures come from EGL (see services.sim.rendering.offscreen).
os.environ.setdefault("MUJOCO_GL", "disable")
