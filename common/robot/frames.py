"""Names of the frames that controller, plant and operator share, with a few fixed poses and sizes.

Frames: x forward, y left, z up. Quaternions are (w, x, y, z). "Body frame" is ``torso_link``.
"""

from collections.abc import Mapping
from typing import Final

BASE_JOINT: Final = "base"
"""The free joint."""
BODY_FRAME: Final = "torso_link"
"""The body frame: hand set-points are expressed in it."""
BASE_COM_FRAME: Final = "base_com"
"""Site 0.087484 m above the body frame; hand set-points of the public TRILL code use it."""
BASE_COM_HEIGHT: Final = 0.087484
IMU_FRAME: Final = "imu"
HEAD_FRAME: Final = "neck_pitch_link"

FOOT_FRAMES: Final[Mapping[str, str]] = {"left": "l_foot", "right": "r_foot"}
"""Sites at the centre of each sole: z up, x towards the toes."""
HAND_FRAMES: Final[Mapping[str, str]] = {"left": "l_hand", "right": "r_hand"}
"""Sites between the finger pads, oriented as the wrist: hand along -z, fingers opening on y."""
CAMERAS: Final[Mapping[str, str]] = {"left": "left", "right": "right"}
"""Cameras of the stereo pair on the head; left is +y. The public MJCF swaps the names."""
CAMERA_BASELINE: Final = 0.06
CAMERA_FOVY_DEG: Final = 120.0

FOOT_SUPPORT_HALF_SIZE: Final[tuple[float, float]] = (0.115, 0.065)
"""Half length (x) and half width (y) of the support rectangle, m (public TRILL configuration)."""
FOOT_COLLISION_HALF_SIZE: Final[tuple[float, float, float]] = (0.125, 0.075, 0.0295)

FOOT_GEOMS: Final[Mapping[str, str]] = {"left": "l_foot_col", "right": "r_foot_col"}
"""Collision boxes of the feet."""
FINGER_GEOMS: Final[Mapping[str, tuple[str, str]]] = {
    "left": ("l_finger_a_col", "l_finger_b_col"),
    "right": ("r_finger_a_col", "r_finger_b_col"),
}
"""Collision geoms of the finger pads."""
COLLISION_SUFFIX: Final = "_col"
"""Suffix of the names of all collision geoms."""

NOMINAL_HAND_IN_BODY: Final[Mapping[str, tuple[float, float, float]]] = {
    "left": (0.3078, 0.2809996, 0.0459949),
    "right": (0.3078, -0.2809996, 0.0459949),
}
"""Hand positions in the body frame at the nominal joint positions, m."""
FORWARD_HAND_IN_BODY: Final[tuple[float, float, float, float]] = (
    0.7071067811865476,
    0.0,
    -0.7071067811865476,
    0.0,
)
"""Orientation of a hand that points straight ahead with the fingers opening sideways."""
