"""Meshes of robots, humans and marks, in metres, standing on z = 0, looking along x."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float32Array, Float64Array, UInt32Array

SIDES = 28
APART_M = 0.04
"""Smallest distance between points of a line [m]."""
ARROW_MIN_M, ARROW_HEAD_M = 0.15, 0.14
"""Length of the shortest arrow, and of arrow heads [m]."""
_TRUNK = (
    (0.0, 0.82),
    (0.13, 0.84),
    (0.155, 0.94),
    (0.125, 1.10),
    (0.16, 1.30),
    (0.17, 1.39),
    (0.11, 1.45),
    (0.0, 1.47),
)
"""Radius and height of hips, waist and shoulders [m]; wider than deep."""
_LIMBS = (
    ((0.0, 0.0, 1.44), (0.0, 0.0, 1.52), 0.052, 0.050),
    ((0.010, 0.0, 1.60), (0.015, 0.0, 1.645), 0.088, 0.098),
    ((0.10, 0.0, 1.60), (0.115, 0.0, 1.59), 0.022, 0.018),
    ((0.01, 0.09, 0.88), (0.13, 0.10, 0.48), 0.088, 0.062),
    ((0.13, 0.10, 0.48), (0.13, 0.10, 0.08), 0.062, 0.045),
    ((0.10, 0.10, 0.05), (0.28, 0.11, 0.05), 0.048, 0.038),
    ((-0.01, -0.09, 0.88), (-0.08, -0.10, 0.48), 0.088, 0.062),
    ((-0.08, -0.10, 0.48), (-0.22, -0.10, 0.12), 0.062, 0.045),
    ((-0.23, -0.10, 0.09), (-0.07, -0.11, 0.05), 0.048, 0.038),
    ((0.0, 0.21, 1.37), (-0.07, 0.25, 1.09), 0.055, 0.044),
    ((-0.07, 0.25, 1.09), (0.08, 0.24, 0.86), 0.044, 0.034),
    ((0.0, -0.21, 1.37), (0.05, -0.25, 1.09), 0.055, 0.044),
    ((0.05, -0.25, 1.09), (0.24, -0.22, 0.93), 0.044, 0.034),
)
"""Begin, end and radii at both [m] of neck, head, nose, legs and arms of a human in mid-stride."""


class ViewerMesh(NamedTuple):
    """A triangle mesh."""

    vertices_m: Float32Array
    """Vertices [m], shape (V, 3)."""
    faces: UInt32Array
    """Vertex indices of the triangles, shape (F, 3)."""


def lathe(profile: npt.ArrayLike, sides: int = SIDES) -> ViewerMesh:
    """A body of revolution around z.

    Args:
        profile: Radius and height [m] from the bottom to the top, shape (P, 2).
        sides: Corners of each ring.
    """
    rings = np.asarray(profile, dtype=np.float32)
    angles = np.arange(sides, dtype=np.float32) * (2 * np.pi / sides)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    xy = rings[:, None, :1] * circle[None]
    z = np.broadcast_to(rings[:, None, 1:], (len(rings), sides, 1))
    vertices = np.concatenate([xy, z], axis=2).reshape(-1, 3)
    i, j = (grid.reshape(-1) for grid in np.meshgrid(np.arange(len(rings) - 1), np.arange(sides), indexing="ij"))
    a, b = i * sides + j, i * sides + (j + 1) % sides
    c, d = a + sides, b + sides
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    return ViewerMesh(vertices.astype(np.float32), faces.astype(np.uint32))


def capsule(begin_m: npt.ArrayLike, end_m: npt.ArrayLike, begin_radius_m: float, end_radius_m: float) -> ViewerMesh:
    """A round limb from one point to another, shape (3,) each."""
    begin, end = np.asarray(begin_m, float), np.asarray(end_m, float)
    length_m = float(np.linalg.norm(end - begin))
    turn = np.linspace(0.0, np.pi / 2, 5)
    low = [(begin_radius_m * np.sin(t), -begin_radius_m * np.cos(t)) for t in turn]
    high = [(end_radius_m * np.cos(t), length_m + end_radius_m * np.sin(t)) for t in turn]
    mesh = lathe([*low, *high], sides=14)
    along = (end - begin) / length_m
    across = np.cross(along, [0.0, 1.0, 0.0] if abs(along[1]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(along, across), along])
    return ViewerMesh((mesh.vertices_m @ axes + begin).astype(np.float32), mesh.faces)


def human() -> ViewerMesh:
    """A walking human, 1.74 m tall; face and feet show the direction."""
    trunk = lathe(_TRUNK, sides=20)
    deep = ViewerMesh(trunk.vertices_m * np.array([0.72, 1.15, 1.0], np.float32), trunk.faces)
    return join_meshes([deep, *(capsule(*limb) for limb in _LIMBS)])


def robot(radius_m: float, height_m: float) -> ViewerMesh:
    """A robot's body: a rounded drum."""
    edge = min(0.25 * radius_m, 0.25 * height_m)
    turn = np.linspace(0.0, np.pi / 2, 6)
    bottom = [(radius_m - 0.04, 0.03), (radius_m, 0.03 + edge)]
    top = [(radius_m - edge * (1 - np.cos(t)), height_m - edge * (1 - np.sin(t))) for t in turn]
    return lathe([(0.0, 0.03), *bottom, *top, (0.0, height_m)])


def band(radius_m: float, low_m: float, high_m: float) -> ViewerMesh:
    """A ring around a body."""
    return lathe([(radius_m, low_m), (radius_m + 0.012, low_m), (radius_m + 0.012, high_m), (radius_m, high_m)])


def disc(radius_m: float, inner_m: float = 0.0) -> ViewerMesh:
    """A flat ring, or a disc without a hole."""
    return lathe([(inner_m, 0.0), (radius_m, 0.0)], sides=48)


def fan(angle_rad: float, reach_m: float, begin_m: float = 0.0) -> ViewerMesh:
    """The ground in a camera's view: a flat sector around x."""
    angles = np.linspace(-angle_rad / 2, angle_rad / 2, 25)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    vertices = np.concatenate([begin_m * circle, reach_m * circle])
    a = np.arange(len(angles) - 1)
    b = a + len(angles)
    faces = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    return ViewerMesh(vertices.astype(np.float32), faces.astype(np.uint32))


def gem(radius_m: float) -> ViewerMesh:
    """A mark: two pyramids, one upside down."""
    return lathe([(0.0, 0.0), (radius_m, 1.3 * radius_m), (0.0, 2.6 * radius_m)], sides=4)


def pin(height_m: float) -> ViewerMesh:
    """A goal's post: thin, with a ball on top."""
    ball = 0.09
    turn = np.linspace(-np.pi / 2 + 0.15, np.pi / 2, 9)
    head = [(ball * np.cos(t), height_m + ball * np.sin(t)) for t in turn]
    return lathe([(0.0, 0.0), (0.014, 0.0), (0.014, height_m - ball), *head], sides=16)


def join_meshes(meshes: list[ViewerMesh]) -> ViewerMesh:
    """Several meshes as one."""
    begins = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes[:-1])])
    faces = [mesh.faces + np.uint32(begin) for mesh, begin in zip(meshes, begins, strict=True)]
    return ViewerMesh(np.concatenate([mesh.vertices_m for mesh in meshes]), np.concatenate(faces))


def move_mesh(mesh: ViewerMesh, x_m: float, y_m: float, z_m: float) -> ViewerMesh:
    """A mesh at another place."""
    return ViewerMesh(mesh.vertices_m + np.array([x_m, y_m, z_m], np.float32), mesh.faces)


def segments(points_m: Float64Array, lift_m: float = 0.0) -> Float32Array:
    """A path of N points as segments of at least `APART_M`, lifted off the floor [m], shape (S, 2, 3) with S < N."""
    raised = _apart(points_m) + np.array([0.0, 0.0, lift_m])
    return np.stack([raised[:-1], raised[1:]], axis=1).astype(np.float32)


def arrow_segments(begin_m: tuple[float, float], end_m: tuple[float, float], height_m: float) -> Float32Array:
    """A flat arrow at a height [m], shape (S, 2, 3); none where begin and end are close."""
    begin, along = np.array(begin_m), np.subtract(end_m, begin_m)
    length_m = float(np.hypot(*along))
    if length_m < ARROW_MIN_M:
        return np.zeros((0, 2, 3), np.float32)
    along = along / length_m
    across = np.array([-along[1], along[0]])
    end, back = begin + length_m * along, begin + (length_m - ARROW_HEAD_M) * along
    corners = (begin, back + 0.6 * ARROW_HEAD_M * across, back - 0.6 * ARROW_HEAD_M * across)
    lines = np.array([[(*corner, height_m), (*end, height_m)] for corner in corners])
    return lines.astype(np.float32)


def _apart(points_m: Float64Array) -> Float64Array:
    """The points of a path without repeated positions: viewers cannot draw segments of length 0."""
    kept = [0]
    for row in range(1, len(points_m)):
        if np.linalg.norm(points_m[row] - points_m[kept[-1]]) > APART_M:
            kept.append(row)
    return points_m[kept]
