"""One robot: `gymnasium.make("readygo.gym:ReadyGo/PointNav-v0", scene="embedded", humans=2)`."""

import itertools
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from readygo.apps.gym.point_nav import NavEpisode, PointNav
from readygo.common.arrays import AnyArray, Float32Array, UInt8Array
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import RATE_HZ

FARTHEST_M = 1000.0
"""Bound of the goal's coordinates in the observation space [m]."""
Observation = dict[str, AnyArray]


def observation_space(robot: RobotConfig) -> spaces.Space[Any]:
    """Observation space: image, goal in the robot's frame [m], and velocities [m/s, rad/s]."""
    height, width = robot.camera.height_px, robot.camera.width_px
    return spaces.Dict(
        {
            "rgb": spaces.Box(0, 255, (height, width, 3), np.uint8),
            "goal": spaces.Box(-FARTHEST_M, FARTHEST_M, (2,), np.float32),
            "velocity": action_space(robot),
        }
    )


def action_space(robot: RobotConfig) -> spaces.Space[Any]:
    """Action space: commands v [m/s] and w [rad/s]."""
    fastest = np.array([robot.v_max_mps, robot.w_max_radps], np.float32)
    return spaces.Box(np.array([robot.v_min_mps, -robot.w_max_radps], np.float32), fastest, dtype=np.float32)


class PointNavEnv(gymnasium.Env[Observation, Float32Array]):
    """Drive to a goal among pedestrians, in steps of `PointNav.robot.clock`. Arguments as for `PointNav`.

    `info` has the costs `cost_collision` and `cost_intrusion` (1 in a step with them, else 0), and with `expert=True`
    the `expert_command` for the next step.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": RATE_HZ}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None, **arguments: Any) -> None:
        self.render_mode = render_mode
        self._task = PointNav(**arguments)
        self.metadata = {**self.metadata, "render_fps": self._task.robot.clock.rate_hz}
        self.observation_space = observation_space(self._task.robot)
        self.action_space = action_space(self._task.robot)
        self._episode: NavEpisode | None = None
        self._seed, self._indices = 0, itertools.count()
        self._seen: UInt8Array | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin the first episode of a seed, or the next one of the last seed."""
        super().reset(seed=seed)
        if seed is not None or self._episode is None:
            self._seed = int(self.np_random.integers(2**31)) if seed is None else seed
            self._indices = itertools.count()
        self._episode = self._task.begin(self._seed, self._indices)
        return self._observation(), self._task.info(self._episode)

    def step(self, action: Float32Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for a step of the robot's clock."""
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("call reset() before step().")
        reward, terminated, truncated = self._task.advance(self._episode, action)
        return self._observation(), reward, terminated, truncated, self._task.info(self._episode)

    def render(self) -> UInt8Array | None:  # type: ignore[override]
        """The robot's latest camera image, RGB, shape (H, W, 3)."""
        return self._seen if self.render_mode == "rgb_array" else None

    def _observation(self) -> Observation:
        assert self._episode is not None
        observation = {name: array[0] for name, array in self._task.observe([self._episode]).items()}
        self._seen = observation["rgb"]
        return observation
