"""What was perceived as a message in the world, for viewers, films and robots."""

import math
from collections.abc import Sequence

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.camera.config import CameraConfig
from readygo.common.messages.episode import EpisodeKey
from readygo.common.messages.live import LivePerception, LivePerson
from readygo.common.perception.grid import polar_grid
from readygo.common.perception.people import People
from readygo.common.perception.perception import Perceived
from readygo.common.perception.tracker import Track

SIGMAS = 2.0
"""Size of a covariance ellipse, in standard deviations."""
AHEAD_S = 1.0
"""Time that a velocity's arrow reaches [s]."""
LIFT_M = 0.05
"""Height above the floor at which viewers show what is perceived [m]."""
_ELLIPSE_CORNERS = 40


def live_perception(
    episode: EpisodeKey,
    time_ns: int,
    robot_xyzyaw: tuple[float, float, float, float],
    perceived: Perceived,
    tracks: Sequence[Track],
    camera: CameraConfig,
) -> LivePerception:
    """What one look told, in the world.

    Args:
        episode: Of the look.
        time_ns: Simulated time of the look [ns].
        robot_xyzyaw: The robot when the image was taken: x, y, z [m], yaw [rad].
        perceived: What the network answered.
        tracks: The tracks after the look.
        camera: The robot's camera.
    """
    x, y, _, yaw = robot_xyzyaw
    return LivePerception(
        episode=episode,
        time_ns=time_ns,
        robot_xyzyaw=robot_xyzyaw,
        detections=detected_people(perceived.people, (x, y, yaw)),
        tracks=tuple(map(tracked_person, tracks)),
        ray_bearings_rad=polar_grid(camera).bearings_rad.astype(np.float32),
        rays_m=perceived.rays_m.astype(np.float32),
    )


def detected_people(people: People, pose: tuple[float, float, float]) -> tuple[LivePerson, ...]:
    """Humans of one image in the world.

    Args:
        people: In the robot's frame.
        pose: The robot when the image was taken: x, y [m], yaw [rad].
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[c, -s], [s, c]])
    xy_m, v_mps = people.xy_m @ turn.T + np.array(pose[:2]), people.v_mps @ turn.T
    return tuple(
        LivePerson(
            number=row,
            presence=float(people.presence[row]),
            xy_m=_pair(xy_m[row]),
            v_mps=_pair(v_mps[row]),
            place_cov_m2=_covariance(turn @ people.place_cov[row] @ turn.T),
            velocity_cov_m2ps2=_covariance(turn @ people.velocity_cov[row] @ turn.T),
        )
        for row in range(len(people))
    )


def tracked_person(track: Track) -> LivePerson:
    """A track as a message."""
    return LivePerson(
        number=track.number,
        presence=1.0 / (1.0 + math.exp(-track.log_odds)),
        xy_m=_pair(track.mean[:2]),
        v_mps=_pair(track.mean[2:]),
        place_cov_m2=_covariance(track.cov[:2, :2]),
        velocity_cov_m2ps2=_covariance(track.cov[2:, 2:]),
        age_s=float(track.age_s),
    )


def covariance_ellipse(person: LivePerson) -> Float64Array:
    """Outline of the covariance of a human's place [m], closed, shape (N, 2)."""
    xx, xy, yy = person.place_cov_m2
    values, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    turns = np.linspace(0.0, 2.0 * np.pi, _ELLIPSE_CORNERS + 1)
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    outline: Float64Array = np.array(person.xy_m) + (SIGMAS * circle * np.sqrt(np.maximum(values, 0.0))) @ axes.T
    return outline


def place_ahead(person: LivePerson) -> tuple[float, float]:
    """Where a human will be after `AHEAD_S` by its velocity [m]."""
    return person.xy_m[0] + AHEAD_S * person.v_mps[0], person.xy_m[1] + AHEAD_S * person.v_mps[1]


def free_points(perception: LivePerception, camera: CameraConfig) -> Float64Array:
    """Ends of the free distances in the world [m], from left to right, shape (C, 2)."""
    x, y, _, yaw = perception.robot_xyzyaw
    eye_x, eye_y, looks_rad = camera.eye(x, y, yaw)
    angles = looks_rad + perception.ray_bearings_rad.astype(np.float64)
    rays_m = perception.rays_m.astype(np.float64)[:, None]
    points: Float64Array = np.array([eye_x, eye_y]) + rays_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return points


def _pair(values: Float64Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _covariance(matrix: Float64Array) -> tuple[float, float, float]:
    return float(matrix[0, 0]), float(matrix[0, 1]), float(matrix[1, 1])
