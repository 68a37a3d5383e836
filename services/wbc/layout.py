"""Order of the reduced coordinates, and of the rows of the frames' stacked Jacobian."""

from common.robot import joints

NUM_MOTORS = joints.NUM_MOTORS
NV = 6 + NUM_MOTORS
"""Dimension of the reduced velocity."""
ARMS = slice(12, 24)
"""Motors of both arms; those of the legs come before them, the neck's after."""
UPPER_BODY = slice(12, NUM_MOTORS)
"""Motors of arms and neck."""
ARM_COLUMNS = slice(6 + ARMS.start, 6 + ARMS.stop)
"""Velocities of both arms' motors."""
SIDES = ("left", "right")
COM = slice(0, 3)
TORSO = slice(3, 6)
HANDS = (slice(6, 12), slice(12, 18))
FEET = (slice(18, 24), slice(24, 30))
FRAMES = (*HANDS, *FEET)
NUM_ROWS = 30
"""Rows of the stacked Jacobian."""
