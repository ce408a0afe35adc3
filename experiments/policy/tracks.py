"""How well the tracker knows people from what perception tells of recorded images."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.camera.view import in_view, view_of
from readygo.common.dataset import Dataset
from readygo.common.maps import clearance_m
from readygo.common.perception import PeopleTracker
from readygo.common.perception.episode import SteppedTracker
from readygo.common.perception.grid import FAR_M
from readygo.common.perception.people import people_of
from readygo.common.perception.tracker import Pose
from readygo.common.robot import RobotConfig
from readygo.common.scenes import SceneMaps
from readygo.services.trainer.episodes import BODY_RADIUS_M
from readygo.services.trainer.perception.looks import Looks
from readygo.services.trainer.perception.metrics import r2

FOUND_M = 0.7
"""A human is tracked if a track that is told is this near to it [m]."""


@dataclass(frozen=True, kw_only=True)
class TrackMeasures:
    """What the told tracks say of visible humans, after each image."""

    people: int
    """Visible humans in all images."""
    tracked: float
    """Share of them that are tracked."""
    place_m: float
    """Median error of the place of those [m]."""
    along_r2: float
    """R2 of their velocity along the line of sight."""
    across_r2: float
    """R2 of their velocity across the line of sight."""
    velocity_mps: float
    """Median length of the error of their velocity [m/s]."""


def measure_tracks(
    answers: Sequence[Float64Array], looks: Looks, dataset: Dataset, robot: RobotConfig, maps: SceneMaps
) -> TrackMeasures:
    """Track the people of each recorded episode through all of its images, as drivers do.

    Args:
        answers: Map of people of each image, as the exported network answers it, shape (9, D, C).
        looks: The images, all of the dataset's.
        dataset: Recorded in one scene.
        robot: Whose camera took them.
        maps: Of the scene.
    """
    clearance, view = clearance_m(maps.human).astype(np.float64), view_of(robot.camera)
    samples = np.flatnonzero(dataset.pictured)

    def shows(pose: Pose, x_m: float, y_m: float) -> bool:
        eye = robot.camera.eye(*pose)
        seen = in_view(eye, x_m, y_m, view, FAR_M, BODY_RADIUS_M)
        return seen and maps.sight.sees(eye[0], eye[1], view.height_m, (x_m, y_m))

    pairs: list[tuple[Float64Array, Float64Array]] = []
    for number in np.unique(looks.episode).tolist():
        tracker = PeopleTracker(clearance, maps.human.frame)
        stepped = SteppedTracker(tracker, dataset.clock.dt_s, shows)
        for row in np.flatnonzero(looks.episode == number).tolist():
            sample = int(samples[row])
            x, y, yaw = dataset.poses[sample][[0, 1, 3]].tolist()
            step = sample - dataset.episodes[number].first_sample
            stepped.look(step, (x, y, yaw), people_of(answers[row], robot.camera))
            tracks = np.array([track.mean for track in tracker.known]).reshape(-1, 4)
            there = looks.labels.people[row][looks.labels.visible[row]].astype(np.float64)
            pairs += _paired(tracks, there, robot.camera.eye(x, y, yaw))
    return _measures(pairs, int(looks.labels.visible.sum()))


def _paired(tracks: Float64Array, there: Float64Array, eye: Pose) -> Iterator[tuple[Float64Array, Float64Array]]:
    """Error of the place (2,), and told and true velocity along and across the line of sight (4,), of tracked humans.

    Args:
        tracks: x, y [m], vx, vy [m/s], shape (N, 4).
        there: `PerceptionLabels.people` of those who are visible, shape (M, 4).
        eye: The camera: x, y [m], yaw [rad].
    """
    for bearing, distance_m, along, across in there.tolist():
        c, s = math.cos(eye[2] + bearing), math.sin(eye[2] + bearing)
        away = tracks[:, :2] - (eye[0] + distance_m * c, eye[1] + distance_m * s)
        error_m = np.hypot(away[:, 0], away[:, 1])
        best = int(np.argmin(error_m)) if len(error_m) else -1
        if best >= 0 and error_m[best] <= FOUND_M:
            vx, vy = tracks[best, 2:].tolist()
            yield away[best], np.array([c * vx + s * vy, c * vy - s * vx, along, across])


def _measures(pairs: Sequence[tuple[Float64Array, Float64Array]], people: int) -> TrackMeasures:
    away = np.array([error for error, _ in pairs]).reshape(-1, 2)
    v = np.array([speeds for _, speeds in pairs]).reshape(-1, 4)
    off = v[:, :2] - v[:, 2:]
    return TrackMeasures(
        people=people,
        tracked=len(pairs) / max(people, 1),
        place_m=float(np.median(np.hypot(away[:, 0], away[:, 1]))) if pairs else math.nan,
        along_r2=r2(v[:, 0], v[:, 2]),
        across_r2=r2(v[:, 1], v[:, 3]),
        velocity_mps=float(np.median(np.hypot(off[:, 0], off[:, 1]))) if pairs else math.nan,
    )
