"""Leaves out what a camera cannot see: MuJoCo hands everything to OpenGL, visible or not."""

from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from common.schemas.arrays import Float64Array as Array

_HIDDEN_GROUP: Final = mujoco.mjNGROUP - 1
"""Group of geoms that ``mujoco.MjvOption`` does not show by default."""


class Culling:
    """Moves the geoms outside the picture into a hidden group.

    A geom is outside if its bounding sphere is beyond one of five planes: the picture's four edges
    and the camera's own plane. It could put no pixel into the picture, which stays the same.
    """

    def __init__(self, model: Any, aspect: float) -> None:
        """Remember the groups of ``model``, which has no other user.

        Args:
            model: the ``mujoco.MjModel``, whose ``geom_group`` is changed.
            aspect: width of the pictures by their height.
        """
        self._model = model
        self._aspect = aspect
        self._groups: NDArray[np.int32] = model.geom_group.copy()
        # Planes have no bounding sphere; MuJoCo says 0.
        self._radii: Array = np.where(model.geom_rbound > 0.0, model.geom_rbound, np.inf)

    def hide_unseen(self, data: Any, scene: Any) -> None:
        """Hide what the camera of ``scene``, a ``mujoco.MjvScene``, cannot see."""
        left, right = scene.camera
        # A picture for both eyes is taken from between them.
        eye = 0.5 * (left.pos + right.pos)
        normals = _outward_normals(left, self._aspect)
        distances = (data.geom_xpos - eye) @ normals.T
        outside = (distances > self._radii[:, None]).any(axis=1)
        self._model.geom_group[:] = np.where(outside, _HIDDEN_GROUP, self._groups)


def _outward_normals(camera: Any, aspect: float) -> Array:
    """Return the unit normals (5, 3), in world, of the planes through the eye that bound its view.

    Args:
        camera: a perspective camera; its frustum is symmetric.
        aspect: width of the picture by its height.
    """
    forward, up = np.array(camera.forward, float), np.array(camera.up, float)
    right = np.cross(forward, up)
    tall = camera.frustum_top / camera.frustum_near
    wide = tall * aspect
    edges = [right - wide * forward, -right - wide * forward, up - tall * forward]
    normals = np.array([*edges, -up - tall * forward, -forward])
    unit: Array = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return unit
