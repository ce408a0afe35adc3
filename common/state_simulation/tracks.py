"""A tracker of people in many episodes: simulated detections of those in view, filtered by person.

Detections err as `PerceptionNoise` says. Every person has a Kalman filter, which coasts after the person left the view.
False alarms have separate slots. Who is who is known: detections are never confused.

Legend: n = robot, m = slot of a track: the first ones are those of the episode's people.
"""

import math
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array, UInt64Array
from readygo.common.camera.config import mounted_at
from readygo.common.camera.view import FieldOfView, in_view
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps.sight import sees_human
from readygo.common.perception.kalman import ACCELERATION_NOISE, predict, update, update_velocity
from readygo.common.perception.noise import MISSED_AT_M, MISSED_MAX, PerceptionNoise
from readygo.common.perception.tracker import CONFIRMING, MEMORY_S, UNCONFIRMED_S
from readygo.common.robot import Clock
from readygo.common.state_simulation.randomness import next_normal, next_uniform
from readygo.common.state_simulation.world import VIEW_RANGE_M, StateWorld

FALSE_SLOTS = 2
"""Tracks of false alarms at a time."""
FLOOR_M = 0.05
"""Standard deviation that the filter adds to every measured position [m]."""
FLOOR_MPS = 0.05
"""Standard deviation that the filter adds to every measured velocity [m/s]."""
START_MPS = 1.0
"""Standard deviation of an unknown velocity, per axis [m/s]."""
_FALSE_NEAR_M, _FALSE_FAR_M = 1.0, 6.0

_in_view = kernel_with_cache(in_view)
_mounted_at = kernel_with_cache(mounted_at)


class TrackerNumbers(NamedTuple):
    """A `PerceptionNoise` by the steps of a clock."""

    missed: float
    bearing_rad: float
    distance: float
    kept: float
    """Correlation of an error from look to look."""
    velocity_mps: float
    """Standard deviation of measured velocities; negative if none are measured."""
    false_share: float
    """Chance of a false alarm per look."""
    every: int
    """Steps from look to look."""
    coast: int
    """Steps that a track lasts without detections."""
    unconfirmed: int
    """Steps that an unconfirmed track lasts without detections."""


class Tracks(NamedTuple):
    """State of the trackers of N robots, with S slots each, the first M for people."""

    mean: Float64Array
    """x, y [m], vx, vy [m/s] at the latest look, shape (N, S, 4)."""
    cov: Float64Array
    """Covariances, shape (N, S, 4, 4)."""
    seen_step: Int64Array
    """Step of the latest detection, -1 without a track, shape (N, S)."""
    hits: Int64Array
    """Detections of each track, shape (N, S)."""
    faults: Float64Array
    """Standard normal errors now: miss, bearing, distance, shape (N, M, 3)."""
    before: Float64Array
    """Where people were at the look before [m], shape (N, M, 2)."""
    random: UInt64Array
    """Streams, shape (N, 1)."""


def make_tracks(robot_count: int, human_count: int) -> Tracks:
    """Trackers without a track.

    Args:
        robot_count: Robots.
        human_count: Most people in an episode.
    """
    slots = human_count + FALSE_SLOTS
    return Tracks(
        mean=np.zeros((robot_count, slots, 4)),
        cov=np.zeros((robot_count, slots, 4, 4)),
        seen_step=np.full((robot_count, slots), -1, np.int64),
        hits=np.zeros((robot_count, slots), np.int64),
        faults=np.zeros((robot_count, human_count, 3)),
        before=np.zeros((robot_count, human_count, 2)),
        random=np.zeros((robot_count, 1), np.uint64),
    )


def has_no_tracks(tracks: Tracks) -> BoolArray:
    """True for robots to whom no person is told, shape (N,)."""
    free: BoolArray = np.all(tracks.seen_step < 0, axis=1)
    return free


def tracker_numbers(noise: PerceptionNoise, clock: Clock) -> TrackerNumbers:
    """The numbers of a perception's errors on a clock; looks are at whole steps."""
    every = max(1, clock.steps(1.0 / noise.rate_hz))
    between_s = every * clock.dt_s
    return TrackerNumbers(
        missed=noise.missed,
        bearing_rad=math.radians(noise.bearing_deg),
        distance=noise.distance,
        kept=noise.correlation_after(between_s),
        velocity_mps=noise.velocity_mps if noise.measures_velocity else -1.0,
        false_share=min(noise.false_alarms_hz * between_s, 1.0),
        every=every,
        coast=clock.steps(MEMORY_S),
        unconfirmed=clock.steps(UNCONFIRMED_S),
    )


@kernel_with_cache
def begin_tracks(tracks: Tracks, n: int, seed: int) -> None:
    """Forget everyone: an episode begins.

    Args:
        tracks: Trackers.
        n: The robot.
        seed: Seed of its stream.
    """
    tracks.random[n, 0] = np.uint64(seed)
    tracks.seen_step[n] = -1
    for m in range(tracks.faults.shape[1]):
        for q in range(3):
            tracks.faults[n, m, q] = next_normal(tracks.random[n])


@kernel_with_cache
def is_visible(world: StateWorld, x: float, y: float, yaw: float, human_x: float, human_y: float) -> bool:
    """True if one of the robot's cameras shows a person, as the expert's cameras do."""
    for k in range(world.cameras.shape[0]):
        c = world.cameras[k]
        view = FieldOfView(c[0], c[1], c[2], c[3], c[4])
        eye_x, eye_y = _mounted_at(x, y, yaw, c[5], c[6])
        eye = (eye_x, eye_y, yaw + c[7])
        if _in_view(eye, human_x, human_y, view, VIEW_RANGE_M, world.human_radius_m) and sees_human(
            world.opaque, world.sight_place, (eye_x, eye_y, c[4]), (human_x, human_y)
        ):
            return True
    return False


@kernel_with_cache
def look(
    world: StateWorld,
    numbers: TrackerNumbers,
    tracks: Tracks,
    n: int,
    step: int,
    pose: tuple[float, float, float],
    human_xy_m: Float64Array,
    count: int,
) -> None:
    """Detect the people in view at a step that is a multiple of `TrackerNumbers.every`.

    Args:
        world: Map and cameras.
        numbers: Errors.
        tracks: Trackers.
        n: The robot.
        step: Steps since its episode began.
        pose: Robot's x [m], y [m], yaw [rad].
        human_xy_m: Where people are [m], at least `count` rows.
        count: People in the episode.
    """
    x, y, yaw = pose
    stream = tracks.random[n]
    if step > 0:
        for m in range(tracks.mean.shape[1]):
            if tracks.seen_step[n, m] >= 0:
                predict(tracks.mean[n, m], tracks.cov[n, m], numbers.every * world.dt_s, ACCELERATION_NOISE)
    fresh = math.sqrt(1.0 - numbers.kept * numbers.kept)
    for m in range(count):
        faults, human_x, human_y = tracks.faults[n, m], human_xy_m[m, 0], human_xy_m[m, 1]
        for q in range(3):
            faults[q] = numbers.kept * faults[q] + fresh * next_normal(stream)
        dx, dy = human_x - x, human_y - y
        distance = math.sqrt(dx * dx + dy * dy)
        rank = 0.5 * (1.0 + math.erf(faults[0] / math.sqrt(2.0)))
        missed = rank < min(numbers.missed * distance / MISSED_AT_M, MISSED_MAX)
        if not missed and is_visible(world, x, y, yaw, human_x, human_y):
            off_rad, stretched = numbers.bearing_rad * faults[1], distance * math.exp(numbers.distance * faults[2])
            _detect(numbers, tracks, n, m, step, (x, y), math.atan2(dy, dx) + off_rad, stretched)
            if numbers.velocity_mps >= 0.0 and step > 0:
                _take_velocity(world, numbers, tracks, n, m, human_x, human_y)
        tracks.before[n, m, 0], tracks.before[n, m, 1] = human_x, human_y
    if numbers.false_share > 0.0 and next_uniform(stream) < numbers.false_share:
        _false_alarm(world, numbers, tracks, n, step, pose)
    for m in range(tracks.mean.shape[1]):
        lasts = numbers.coast if tracks.hits[n, m] >= CONFIRMING else numbers.unconfirmed
        if step - tracks.seen_step[n, m] > lasts:
            tracks.seen_step[n, m] = -1


@kernel_with_cache
def _detect(
    numbers: TrackerNumbers,
    tracks: Tracks,
    n: int,
    m: int,
    step: int,
    robot_xy_m: tuple[float, float],
    bearing_rad: float,
    distance_m: float,
) -> None:
    """Take in a detection at a bearing in the world and a distance from the robot."""
    mean, cov = tracks.mean[n, m], tracks.cov[n, m]
    c, s = math.cos(bearing_rad), math.sin(bearing_rad)
    along, across = numbers.distance * distance_m, numbers.bearing_rad * distance_m
    along, across = along * along + FLOOR_M * FLOOR_M, across * across + FLOOR_M * FLOOR_M
    measured, variance = np.empty(2), np.empty((2, 2))
    measured[0], measured[1] = robot_xy_m[0] + c * distance_m, robot_xy_m[1] + s * distance_m
    variance[0, 0], variance[1, 1] = c * c * along + s * s * across, s * s * along + c * c * across
    variance[0, 1] = variance[1, 0] = c * s * (along - across)
    if tracks.seen_step[n, m] >= 0:
        update(mean, cov, measured, variance)
        tracks.hits[n, m] += 1
    else:
        mean[:] = 0.0
        cov[:] = 0.0
        mean[:2] = measured
        cov[:2, :2] = variance
        cov[2, 2] = cov[3, 3] = START_MPS * START_MPS
        tracks.hits[n, m] = 1
    tracks.seen_step[n, m] = step


@kernel_with_cache
def _take_velocity(
    world: StateWorld, numbers: TrackerNumbers, tracks: Tracks, n: int, m: int, human_x: float, human_y: float
) -> None:
    """Take in a measured velocity."""
    between_s = numbers.every * world.dt_s
    measured, variance = np.empty(2), np.zeros((2, 2))
    measured[0] = (human_x - tracks.before[n, m, 0]) / between_s
    measured[1] = (human_y - tracks.before[n, m, 1]) / between_s
    for axis in range(2):
        if numbers.velocity_mps > 0.0:
            measured[axis] += numbers.velocity_mps * next_normal(tracks.random[n])
        variance[axis, axis] = numbers.velocity_mps * numbers.velocity_mps + FLOOR_MPS * FLOOR_MPS
    update_velocity(tracks.mean[n, m], tracks.cov[n, m], measured, variance)


@kernel_with_cache
def _false_alarm(
    world: StateWorld, numbers: TrackerNumbers, tracks: Tracks, n: int, step: int, pose: tuple[float, float, float]
) -> None:
    """Detect a person who is not there, somewhere in the first camera's view."""
    stream = tracks.random[n]
    share, camera = next_uniform(stream), world.cameras[0]
    bearing = pose[2] + camera[7] - camera[1] + share * (camera[0] + camera[1])
    distance = _FALSE_NEAR_M + next_uniform(stream) * (_FALSE_FAR_M - _FALSE_NEAR_M)
    first = tracks.faults.shape[1]
    slot = first
    for m in range(first, tracks.mean.shape[1]):
        if tracks.seen_step[n, m] < tracks.seen_step[n, slot]:
            slot = m
    tracks.seen_step[n, slot] = -1
    _detect(numbers, tracks, n, slot, step, (pose[0], pose[1]), bearing, distance)
