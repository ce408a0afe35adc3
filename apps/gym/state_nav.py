"""Many robots that are told states: `gymnasium.make_vec("readygo.gym:ReadyGo/StateNav-v0", num_envs=64)`.

Observations are the numbers of `readygo.common.state_simulation.observe`, actions the robot's grid of commands,
each held for `hold_s`. One compiled call advances all robots.
"""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from readygo.common.arrays import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array
from readygo.common.errors import ConfigError
from readygo.common.messages import Split
from readygo.common.perception.noise import PERCEIVED, PerceptionNoise
from readygo.common.state_policy.state_policy import commands_of, hold_steps_of
from readygo.common.state_simulation.simulation import (
    RUNNING,
    SUCCESS,
    TIMEOUT,
    RewardConfig,
    StateSimulation,
    StateSimulationConfig,
)
from readygo.common.state_simulation.tracks import tracker_numbers
from readygo.common.state_simulation.world import ObservationConfig
from readygo.runs.config import load_run_config
from readygo.runs.evaluation import evaluation_world
from readygo.runs.reinforcement import draw_bank
from readygo.runs.state_world import state_world

LARGEST = 100.0
"""Bound of the observation space; most numbers are within 1."""


class StateNavVectorEnv(VectorEnv[Float32Array, Int64Array, AnyArray]):
    """`num_envs` robots in one scene, each in a random episode of a bank.

    A robot whose episode has ended begins the next one in the following step, which ignores its action. With
    `autoreset_mode=AutoresetMode.SAME_STEP` it begins immediately, and `info` has the last observation in `final_obs`.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        *,
        scene: str = "embedded",
        episodes: int = 500,
        avatars: str | Path | None = None,
        split: str = "train",
        config: str | Path | None = None,
        noise: PerceptionNoise = PERCEIVED,
        observation: ObservationConfig | None = None,
        hold_s: float = 0.2,
        static_share: float = 0.3,
        reward: RewardConfig | None = None,
        truth: bool = False,
    ) -> None:
        """Load a scene and its episodes, which are drawn once and kept in the user's cache.

        Args:
            num_envs: Robots.
            render_mode: None; there are no images.
            autoreset_mode: NEXT_STEP or SAME_STEP.
            scene: Scene bundle, or "embedded".
            episodes: Episodes of the bank.
            avatars: Avatar file or folder of avatars; the embedded ones by default.
            split: Split of the episodes: "train", "val" or "test".
            config: TOML file with sections of settings, as for `readygo generate`.
            noise: Errors of the detections of people.
            observation: What robots are told.
            hold_s: Time that a command is held [s].
            static_share: Share of the episodes without people.
            reward: What a decision earns.
            truth: True keeps what a critic may know in the attribute `truth`.

        Raises:
            ReadygoError: If scene, avatars or settings cannot be used.
        """
        if autoreset_mode is AutoresetMode.DISABLED or render_mode is not None:
            raise ConfigError("autoreset_mode is NEXT_STEP or SAME_STEP, and render_mode None: there are no images.")
        try:
            part = Split(split)
        except ValueError as error:
            raise ConfigError(str(error)) from error
        settings = load_run_config(None if config is None else Path(config))
        place = None if avatars is None else Path(avatars)
        world = evaluation_world(scene, settings, avatars=place, seed=0, split=part)
        plays = StateSimulationConfig(
            hold_steps=hold_steps_of(settings.robot, hold_s),
            static_share=static_share,
            reward=reward or RewardConfig(),
        )
        self._simulation = StateSimulation(
            state_world(world, observation or ObservationConfig()),
            draw_bank(world, part, episodes),
            tracker_numbers(noise, settings.robot.clock),
            num_envs,
            config=plays,
            knows_truth=truth,
        )
        self._commands: Float64Array = commands_of(settings.robot)
        self.num_envs, self.render_mode = num_envs, render_mode
        self._same_step = autoreset_mode is AutoresetMode.SAME_STEP
        self._seeded = False
        self.metadata = {**self.metadata, "autoreset_mode": autoreset_mode}
        told = self._simulation.told.shape[1]
        self.single_observation_space = spaces.Box(-LARGEST, LARGEST, (told,), np.float32)
        self.single_action_space = spaces.Discrete(len(self._commands))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    @property
    def truth(self) -> Float32Array:
        """What a critic may know, shape (num_envs, J); J is 0 without `truth=True`."""
        return self._simulation.truth

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Begin a random episode for every robot; a list's first seed counts for all.

        Without a seed the first call draws one, and later calls continue.
        """
        first = seed[0] if isinstance(seed, list) and seed else seed
        super().reset(seed=first if isinstance(first, int) else None)
        if isinstance(first, int):
            self._simulation.seed(first)
        elif not self._seeded:
            self._simulation.seed(int(self.np_random.integers(2**31)))
        self._seeded = True
        self._simulation.begin_anywhere()
        return self._simulation.told.copy(), {}

    def step(self, actions: Int64Array) -> tuple[Float32Array, Float32Array, BoolArray, BoolArray, dict[str, Any]]:
        """Let every robot follow a command of the grid."""
        simulation = self._simulation
        ended_before = np.flatnonzero(simulation.last.outcome != RUNNING)
        last = simulation.advance(self._commands[np.asarray(actions)], again=False)
        ended, timeout = last.ended.copy(), last.outcome == TIMEOUT
        info: dict[str, Any] = {}
        rows = np.flatnonzero(ended)
        if rows.size:
            info = {
                "success": last.outcome == SUCCESS,
                "dynamic": last.dynamic.copy(),
                "steps": last.length.copy(),
                **{f"_{name}": ended for name in ("success", "dynamic", "steps")},
            }
        if self._same_step and rows.size:
            final = np.empty(self.num_envs, object)
            for k in rows.tolist():
                final[k] = simulation.told[k].copy()
            info |= {"final_obs": final, "_final_obs": ended}
        begins = rows if self._same_step else ended_before
        if begins.size:
            simulation.begin_anywhere(begins)
        return simulation.told.copy(), last.reward.copy(), ended & ~timeout, ended & timeout, info


class StateNavEnv(gymnasium.Env[Float32Array, int]):
    """One robot that is told states. Arguments as for `StateNavVectorEnv`."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None, **arguments: Any) -> None:
        self._one = StateNavVectorEnv(1, render_mode, AutoresetMode.NEXT_STEP, **arguments)
        self.render_mode = render_mode
        self.observation_space, self.action_space = self._one.single_observation_space, self._one.single_action_space
        self._began = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Begin a random episode."""
        super().reset(seed=seed)
        told, info = self._one.reset(seed=seed)
        self._began = True
        return told[0], info

    def step(self, action: int) -> tuple[Float32Array, float, bool, bool, dict[str, Any]]:
        """Follow a command of the grid."""
        if not self._began:
            raise gymnasium.error.ResetNeeded("call reset() before step().")
        told, rewards, terminated, truncated, infos = self._one.step(np.array([action]))
        info = {name: values[0].item() for name, values in infos.items() if not name.startswith("_")}
        return told[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), info
