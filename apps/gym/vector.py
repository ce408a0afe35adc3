"""Many robots rendered in one batch: `gymnasium.make_vec("readygo.gym:ReadyGo/PointNav-v0", num_envs=8)`."""

import itertools
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from readygo.apps.gym.env import Observation, action_space, observation_space
from readygo.apps.gym.point_nav import NavEpisode, PointNav
from readygo.common.arrays import AnyArray, BoolArray, Float32Array, Float64Array, UInt8Array
from readygo.common.errors import ConfigError
from readygo.common.robot.kinematics import RATE_HZ


class PointNavVectorEnv(VectorEnv[Observation, Float32Array, AnyArray]):
    """`num_envs` robots in one scene, each in a separate episode. Arguments as for `PointNav`.

    A robot whose episode has ended begins the next one in the following step, which ignores its action. With
    `autoreset_mode=AutoresetMode.SAME_STEP` it begins immediately, and `info` has the last observation in `final_obs`,
    and `final_info`.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": RATE_HZ,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        **arguments: Any,
    ) -> None:
        if autoreset_mode is AutoresetMode.DISABLED:
            raise ConfigError("Robots begin again by themselves: autoreset_mode is NEXT_STEP or SAME_STEP.")
        self.num_envs, self.render_mode = num_envs, render_mode
        self._same_step = autoreset_mode is AutoresetMode.SAME_STEP
        self._task = PointNav(**arguments)
        fps = self._task.robot.clock.rate_hz
        self.metadata = {**self.metadata, "autoreset_mode": autoreset_mode, "render_fps": fps}
        self.single_observation_space = observation_space(self._task.robot)
        self.single_action_space = action_space(self._task.robot)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._episodes: list[NavEpisode] = []
        self._seeds = [0] * num_envs
        self._indices = [itertools.count() for _ in range(num_envs)]
        self._seen: UInt8Array | None = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode for every robot: robot k has the seed `seed + k`, or the k-th of a list."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else list(seed or [])
        if not seeds and not self._episodes:
            seeds = self.np_random.integers(2**31, size=self.num_envs).tolist()
        for k, each in enumerate(seeds):
            if each is not None:
                self._seeds[k], self._indices[k] = int(each), itertools.count()
        self._episodes = [self._begin(k) for k in range(self.num_envs)]
        return self._observe(), self._infos()

    def step(self, actions: Float32Array) -> tuple[Observation, Float64Array, BoolArray, BoolArray, dict[str, Any]]:
        """Drive for a step of the robot's clock."""
        if not self._episodes:
            raise gymnasium.error.ResetNeeded("call reset() before step().")
        rewards = np.zeros(self.num_envs)
        terminated, truncated = np.zeros(self.num_envs, np.bool_), np.zeros(self.num_envs, np.bool_)
        for k, action in enumerate(actions):
            if self._episodes[k].simulation.outcome is not None:
                self._episodes[k] = self._begin(k)
            else:
                rewards[k], terminated[k], truncated[k] = self._task.advance(self._episodes[k], action)
        final = self._begin_again(terminated | truncated) if self._same_step else {}
        return self._observe(), rewards, terminated, truncated, self._infos() | final

    def render(self) -> tuple[UInt8Array, ...] | None:  # type: ignore[override]
        """The robots' latest camera images, RGB, shape (H, W, 3) each."""
        return tuple(self._seen) if self.render_mode == "rgb_array" and self._seen is not None else None

    def _begin_again(self, ended: BoolArray) -> dict[str, Any]:
        """Replace ended episodes by the next ones; returns the last observations and infos in Gymnasium's format."""
        infos: dict[str, Any] = {}
        for k in np.flatnonzero(ended).tolist():
            last = {name: array[0] for name, array in self._task.observe([self._episodes[k]]).items()}
            infos = self._add_info(infos, {"final_obs": last, "final_info": self._task.info(self._episodes[k])}, k)
            self._episodes[k] = self._begin(k)
        return infos

    def _begin(self, k: int) -> NavEpisode:
        return self._task.begin(self._seeds[k], self._indices[k])

    def _observe(self) -> Observation:
        observation = self._task.observe(self._episodes)
        self._seen = observation["rgb"]
        return observation

    def _infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        for k, episode in enumerate(self._episodes):
            infos = self._add_info(infos, self._task.info(episode), k)
        return infos
