"""Where in a scene a person is filmed: free floor for the walk, and free sight from the camera."""

import itertools
import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.errors import AvatarError
from readygo.common.maps import clearance_m
from readygo.common.scenes import Scene

_YAWS = 24
_TRIED = 2000
"""Places that are tried, those with most room first."""
_SIGHT_M = 0.1
"""Clearance of the line of sight over the floor [m]."""


def place_in(scene: Scene, room_m: float, middle_m: Float64Array, eye_m: Float64Array) -> Float64Array:
    """Pose of a film's world in that of a scene, shape (4, 4): the film's floor lies on the scene's.

    Args:
        scene: The scene.
        room_m: Radius around the middle that has to be free [m].
        middle_m: Middle of the walk in the film's world [m], shape (2,).
        eye_m: The camera there [m], shape (2,).

    Raises:
        AvatarError: If the scene has no such place.
    """
    human = scene.maps.human
    clear = clearance_m(human)
    rows, columns = np.nonzero(clear >= room_m)
    order = np.argsort(-clear[rows, columns], kind="stable")[:_TRIED]
    ahead = eye_m - middle_m
    reach_m, angle = float(np.hypot(*ahead)), math.atan2(ahead[1], ahead[0])
    along = np.arange(0.0, reach_m, human.frame.resolution_m)
    for place, yaw in itertools.product(order.tolist(), 2 * math.pi * np.arange(_YAWS) / _YAWS):
        x, y = human.frame.centre_m(int(rows[place]), int(columns[place]))
        line = np.stack([x + along * math.cos(yaw + angle), y + along * math.sin(yaw + angle)], axis=1)
        cells = np.array([human.frame.cell(*point) for point in line.tolist()])
        inside = (cells >= 0).all(axis=1) & (cells < human.occupied.shape).all(axis=1)
        if inside.all() and (clear[cells[:, 0], cells[:, 1]] >= _SIGHT_M).all():
            return _pose(x, y, scene.maps.floor.at(x, y), yaw, middle_m)
    raise AvatarError(
        f"Scene {scene.name} has no free floor with a radius of {room_m:.2f} m that is seen from {reach_m:.1f} m away; "
        "walk a smaller circle with --walk-radius-m."
    )


def _pose(x: float, y: float, z: float, yaw: float, middle_m: Float64Array) -> Float64Array:
    T = np.eye(4)
    T[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    T[:3, 3] = x, y, z
    T[:2, 3] -= T[:2, :2] @ middle_m
    return T
