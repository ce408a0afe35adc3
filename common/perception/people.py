"""People as one look shows them, in the robot's frame."""

import math
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.camera.config import CameraConfig
from readygo.common.perception.grid import SAME_PERSON_M, peaks

PRESENCE, BEARING, DISTANCE, ALONG, ACROSS, BEARING_SD, DISTANCE_SD, ALONG_SD, ACROSS_SD = range(9)
"""Channels of the map of people: probability; bearing [rad], distance [m] from the camera; velocity of the human over
the ground along the line of sight (away) and to its left [m/s]; standard deviations of bearing [rad], of the logarithm
of the distance, and of both velocities [m/s]."""
CHANNELS = 9
THRESHOLD = 0.16
"""Smallest value of a cell that is told: about half of those with it are humans, because the focal loss answers low."""


@dataclass(frozen=True, kw_only=True, eq=False)
class People:
    """N humans in the robot's frame (x forward, y left), the likeliest first."""

    presence: Float64Array
    """How likely each is there, shape (N,)."""
    xy_m: Float64Array
    """Places [m], shape (N, 2)."""
    place_cov: Float64Array
    """Covariances of the places [m2], shape (N, 2, 2)."""
    v_mps: Float64Array
    """Velocities over the ground [m/s], shape (N, 2)."""
    velocity_cov: Float64Array
    """Covariances of the velocities [m2/s2], shape (N, 2, 2)."""

    def __len__(self) -> int:
        return len(self.presence)


NOBODY = People(
    presence=np.empty(0),
    xy_m=np.empty((0, 2)),
    place_cov=np.empty((0, 2, 2)),
    v_mps=np.empty((0, 2)),
    velocity_cov=np.empty((0, 2, 2)),
)


def people_of(answers: Float64Array, camera: CameraConfig, *, threshold: float = THRESHOLD) -> People:
    """The humans of a map.

    Args:
        answers: The map, channels as above, shape (9, D, C).
        camera: The robot's camera that it is of.
        threshold: Less likely humans are left out.
    """
    cells = peaks(answers[PRESENCE], threshold)
    told = answers[:, cells[:, 0], cells[:, 1]].T
    return people_at(told, camera)


def people_at(told: Float64Array, camera: CameraConfig) -> People:
    """Humans of channels as above, shape (N, 9); of those in one place the first."""
    eye_x, eye_y, eye_yaw = camera.eye(0.0, 0.0, 0.0)
    turn = eye_yaw + told[:, BEARING]
    c, s = np.cos(turn), np.sin(turn)
    xy_m = np.stack([eye_x + told[:, DISTANCE] * c, eye_y + told[:, DISTANCE] * s], axis=1)
    kept: list[int] = []
    for row, (x, y) in enumerate(xy_m.tolist()):
        if all(math.hypot(x - xy_m[k, 0], y - xy_m[k, 1]) >= SAME_PERSON_M for k in kept):
            kept.append(row)
    told, c, s, xy_m = told[kept], c[kept], s[kept], xy_m[kept]
    # Columns: along the line of sight, and to its left.
    axes = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=1)
    along_m = told[:, DISTANCE] * told[:, DISTANCE_SD]
    across_m = told[:, DISTANCE] * told[:, BEARING_SD]
    v = np.einsum("nij,nj->ni", axes, told[:, [ALONG, ACROSS]])
    return People(
        presence=told[:, PRESENCE],
        xy_m=xy_m,
        place_cov=_turned(axes, np.stack([along_m, across_m], axis=1)),
        v_mps=v,
        velocity_cov=_turned(axes, told[:, [ALONG_SD, ACROSS_SD]]),
    )


def _turned(axes: Float64Array, deviations: Float64Array) -> Float64Array:
    """Covariances of deviations along axes, shapes (N, 2, 2) and (N, 2) -> (N, 2, 2)."""
    covariances: Float64Array = np.einsum("nik,nk,njk->nij", axes, deviations**2, axes)
    return covariances
