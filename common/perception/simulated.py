"""What a network would tell of people, from where they truly are: the errors of `PerceptionNoise`, drawn."""

import math

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.camera.config import CameraConfig
from readygo.common.perception.noise import MISSED_AT_M, MISSED_MAX, PerceptionNoise
from readygo.common.perception.people import NOBODY, People, people_at

_LEAST_RAD, _LEAST_LOG = math.radians(0.3), 0.01
"""Deviations that are told of what is perceived without errors."""
_UNKNOWN_MPS = 3.0
"""Deviation of a velocity that is not measured [m/s]."""
_VELOCITY_LEAST_MPS = 0.05


class SimulatedPerception:
    """Perceives the people of one episode, with errors that hang together over time."""

    def __init__(self, noise: PerceptionNoise, camera: CameraConfig, rng: np.random.Generator) -> None:
        """Begin an episode.

        Args:
            noise: How it errs.
            camera: The robot's camera.
            rng: Draws the errors.
        """
        self._noise, self._camera, self._rng = noise, camera, rng
        self._errors = np.empty((0, 5))
        """Standard normal numbers of each human: missed, bearing, distance, velocity along and across."""
        self._latest_s = -math.inf

    def look(
        self,
        time_s: float,
        pose: tuple[float, float, float],
        human_xy_m: Float64Array,
        human_v_mps: Float64Array,
        visible: BoolArray,
    ) -> People:
        """What one look tells, in the robot's frame.

        Args:
            time_s: Time of the look [s].
            pose: The robot: x, y [m], yaw [rad].
            human_xy_m: Where the humans are [m], shape (N, 2).
            human_v_mps: How they move [m/s], shape (N, 2).
            visible: Which of them the camera shows, shape (N,).
        """
        self._drift(time_s, len(human_xy_m))
        rows = [
            row
            for human in np.flatnonzero(visible).tolist()
            if (row := self._told(self._errors[human], pose, human_xy_m[human], human_v_mps[human])) is not None
        ]
        return people_at(np.array(rows), self._camera) if rows else NOBODY

    def _drift(self, time_s: float, count: int) -> None:
        if len(self._errors) < count:
            more = self._rng.standard_normal((count - len(self._errors), 5))
            self._errors = np.concatenate([self._errors, more])
        if math.isfinite(self._latest_s):
            kept = self._noise.correlation_after(time_s - self._latest_s)
            fresh = self._rng.standard_normal(self._errors.shape)
            self._errors = kept * self._errors + math.sqrt(1.0 - kept * kept) * fresh
        self._latest_s = time_s

    def _told(
        self, errors: Float64Array, pose: tuple[float, float, float], xy_m: Float64Array, v_mps: Float64Array
    ) -> Float64Array | None:
        """Channels of one human, see `readygo.common.perception.people`; None if it is missed."""
        noise = self._noise
        eye_x, eye_y, eye_yaw = self._camera.eye(*pose)
        dx, dy = float(xy_m[0]) - eye_x, float(xy_m[1]) - eye_y
        distance_m, towards = max(math.hypot(dx, dy), 0.05), math.atan2(dy, dx)
        missed = min(noise.missed * distance_m / MISSED_AT_M, MISSED_MAX)
        if 0.5 * (1.0 + math.erf(float(errors[0]) / math.sqrt(2.0))) < missed:
            return None
        c, s = math.cos(towards), math.sin(towards)
        bearing_sd = math.radians(noise.bearing_deg)
        velocity_sd = noise.velocity_mps if noise.measures_velocity else _UNKNOWN_MPS
        known = float(noise.measures_velocity)
        return np.array(
            [
                1.0 - missed,
                math.remainder(towards - eye_yaw, math.tau) + bearing_sd * errors[1],
                distance_m * math.exp(noise.distance * errors[2]),
                known * (c * v_mps[0] + s * v_mps[1] + velocity_sd * errors[3]),
                known * (c * v_mps[1] - s * v_mps[0] + velocity_sd * errors[4]),
                max(bearing_sd, _LEAST_RAD),
                max(noise.distance, _LEAST_LOG),
                max(velocity_sd, _VELOCITY_LEAST_MPS),
                max(velocity_sd, _VELOCITY_LEAST_MPS),
            ]
        )
