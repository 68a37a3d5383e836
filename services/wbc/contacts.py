"""Foot contact: the wrench cone of a rectangular sole and the bound on its normal force.

A wrench is [fx, fy, fz, mx, my, mz] in the sole's own frame (z up, origin at the centre), so the
cone is a constant matrix: U f >= 0 (Caron, Pham, Nakamura 2015, eq. 13-16).
"""

import numpy as np

from common.schemas.arrays import Float64Array as Array
from services.wbc.config import ContactConfig

CONE_ROWS = 17
FZ = 2
"""Index of the normal force in a wrench."""


def wrench_cone(config: ContactConfig) -> Array:
    """Cone matrix U (17, 6): unilateral, friction pyramid, centre of pressure, yaw torque."""
    mu, x, y = config.friction, config.half_length, config.half_width
    rows = [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]
    for sign in (1.0, -1.0):
        rows.append([sign, 0.0, mu, 0.0, 0.0, 0.0])
        rows.append([0.0, sign, mu, 0.0, 0.0, 0.0])
        rows.append([0.0, 0.0, y, sign, 0.0, 0.0])
        rows.append([0.0, 0.0, x, 0.0, sign, 0.0])
    reach = mu * (x + y)
    for a in (1.0, -1.0):
        for b in (1.0, -1.0):
            # mz >= mz_min and mz <= mz_max, both over the four sign patterns.
            rows.append([a * y, b * x, reach, -a * mu, -b * mu, 1.0])
            rows.append([a * y, b * x, reach, a * mu, b * mu, -1.0])
    return np.array(rows)
