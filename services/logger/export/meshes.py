"""Triangulates the robot's visible shapes, one mesh for each link and colour."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

VISUAL_GROUP = 2
"""Group of the geoms that are visible, not collision shapes."""
_SIDES = 20
"""Number of sides of a round shape."""
_BOX, _CYLINDER, _CAPSULE, _MESH = "BOX", "CYLINDER", "CAPSULE", "MESH"

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Shape = tuple[Array, Indices]
"""Vertices (n, 3) [m] and triangles (m, 3)."""


@dataclass(frozen=True, slots=True)
class LinkMesh:
    """The visible shapes of one link that have one colour, in the link's frame.

    Attributes:
        link: name of the link.
        colour: red, green, blue from 0 to 1.
        vertices: (n, 3) [m].
        triangles: (m, 3) indices of vertices, counter-clockwise seen from outside.
    """

    link: str
    colour: tuple[float, ...]
    vertices: Array
    triangles: Indices

    def faceted(self) -> tuple[Array, Array]:
        """Return the triangles' corners (3 m, 3) [m] in turn, and their outward unit normals."""
        corners = self.vertices[self.triangles]
        faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(faces, axis=1, keepdims=True)
        normals = faces / np.where(lengths > 0.0, lengths, 1.0)
        return corners.reshape(-1, 3), np.repeat(normals, 3, axis=0)


def link_meshes(model: Any) -> list[LinkMesh]:
    """Return the visual geoms of a MuJoCo model, joined by link and colour."""
    import mujoco

    turn = np.zeros(9)
    parts: dict[tuple[int, tuple[float, ...]], list[Shape]] = {}
    for geom in range(model.ngeom):
        shape = _shape(model, geom) if model.geom_group[geom] == VISUAL_GROUP else None
        if shape is None:
            continue
        vertices, triangles = shape
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        placed = vertices @ turn.reshape(3, 3).T + model.geom_pos[geom]
        material = model.geom_matid[geom]
        rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        key = int(model.geom_bodyid[geom]), tuple(rgba[:3].tolist())
        parts.setdefault(key, []).append((placed, triangles))
    return [
        LinkMesh(model.body(body).name, colour, *_joined(shapes))
        for (body, colour), shapes in parts.items()
    ]


def _joined(shapes: list[Shape]) -> Shape:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in shapes)])
    return (
        np.concatenate([vertices for vertices, _ in shapes]),
        np.concatenate([t + start for (_, t), start in zip(shapes, starts, strict=False)]),
    )


def _shape(model: Any, geom: int) -> Shape | None:
    import mujoco

    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_")
    size = model.geom_size[geom].astype(float)
    if kind == _MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    if kind == _BOX:
        return box(size)
    if kind == _CYLINDER:
        return turned([(0.0, -size[1]), (size[0], -size[1]), (size[0], size[1]), (0.0, size[1])])
    if kind == _CAPSULE:
        arc = [
            (size[0] * np.cos(angle), size[0] * np.sin(angle))
            for angle in np.linspace(-np.pi / 2, np.pi / 2, 10)
        ]
        return turned([(r, z + (size[1] if z > 0.0 else -size[1])) for r, z in arc])
    return None


def _mesh(model: Any, mesh: int) -> Shape:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    vertices = model.mesh_vert[first : first + count].astype(float)
    return vertices, model.mesh_face[face : face + faces].astype(np.int64)


def box(half: Array) -> Shape:
    """Return a box of half sizes ``half`` (3,) [m] about the origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return corners, np.array(triangles)


def turned(profile: list[tuple[float, float]]) -> Shape:
    """Return the solid that a ``profile`` of (radius, height) [m], from below, sweeps around z."""
    angles = np.arange(_SIDES) * 2.0 * np.pi / _SIDES
    rings = [[(r * np.cos(a), r * np.sin(a), z) for a in angles] for r, z in profile]
    triangles = []
    for ring in range(len(profile) - 1):
        for side in range(_SIDES):
            after = (side + 1) % _SIDES
            a, b = ring * _SIDES + side, ring * _SIDES + after
            c, d = a + _SIDES, b + _SIDES
            triangles += [(a, b, d), (a, d, c)]
    vertices = np.array(rings).reshape(-1, 3)
    indices = np.array(triangles)
    corners = vertices[indices]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return vertices, indices[np.linalg.norm(across, axis=1) > 0.0]
