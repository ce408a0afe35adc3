"""The task behind the environments: episodes, observations, rewards and costs."""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray, Float32Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.conduct import PERSONAL_SPACE_M
from readygo.common.episode.loop import EpisodeRun, Observer
from readygo.common.errors import ConfigError
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.common.policy import PolicySpec, load_spec
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.evaluation import evaluation_world, make_evaluator
from readygo.runs.origin import avatars_of_policy, settings_of_policy
from readygo.services.evaluator import GoalField, Task, as_task
from readygo.services.planner import Expert


@dataclass(frozen=True, kw_only=True)
class Reward:
    """Weights of the reward of a step."""

    per_metre: float = 1.0
    """Reward per metre by which the shortest path to the goal became shorter [1/m]."""
    per_second: float = -0.1
    success: float = 10.0
    collision: float = -10.0


class RewardObserver(Observer):
    """Observer that computes the reward of each step of an episode."""

    def __init__(self, reward: Reward) -> None:
        self._reward = reward
        self.left_m = math.inf
        """Length of the shortest path to the goal [m]."""
        self.value = 0.0
        """Reward of the latest step."""

    def begin(self, simulation: EpisodeSimulation) -> None:
        """Compute the shortest paths to the goal."""
        goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
        self._paths = GoalField(simulation.robot_map, simulation.robot.planning_radius_m, (goal_x, goal_y))
        self.left_m = self._paths.distance_m(simulation.x_m, simulation.y_m)

    def step(self, simulation: EpisodeSimulation) -> None:
        """Compute the reward of the step before this state."""
        self._count(simulation)

    def end(self, simulation: EpisodeSimulation) -> None:
        """Compute the reward of the last step."""
        self._count(simulation)

    def _count(self, simulation: EpisodeSimulation) -> None:
        reward, outcome = self._reward, simulation.outcome
        left_m = self._paths.distance_m(simulation.x_m, simulation.y_m)
        gained_m = self.left_m - left_m if math.isfinite(left_m) and math.isfinite(self.left_m) else 0.0
        self.left_m = left_m
        self.value = reward.per_metre * gained_m + reward.per_second * simulation.clock.dt_s
        self.value += (
            reward.success if outcome is Outcome.SUCCESS else reward.collision if _is_collision(outcome) else 0.0
        )


@dataclass(eq=False)
class NavEpisode:
    """One running episode of an environment."""

    key: EpisodeKey
    run: EpisodeRun
    reward: RewardObserver
    expert: Expert | None = None

    @property
    def simulation(self) -> EpisodeSimulation:
        """Simulation of the robot and its world."""
        return self.run.simulation


class PointNav:
    """Point-goal navigation in one scene."""

    def __init__(
        self,
        *,
        scene: str = "embedded",
        humans: int = 2,
        reactive: bool = False,
        avatars: str | Path | None = None,
        split: str = "train",
        config: str | Path | None = None,
        policy: str | Path | None = None,
        image_px: tuple[int, int] = (72, 128),
        expert: bool = False,
        reward: Reward | None = None,
    ) -> None:
        """Load a scene.

        Args:
            scene: Scene bundle, or "embedded".
            humans: Number of humans; 0 for none.
            reactive: True lets humans avoid the robot.
            avatars: Avatar file or folder of avatars; the embedded ones by default.
            split: Split of the episodes: "train", "val" or "test".
            config: TOML file with sections of settings, as for `readygo generate`.
            policy: Folder of a policy, whose robot, camera, sensor and settings are the defaults of `config`, and whose
                avatars are the default of `avatars`.
            image_px: Height and width of the image [px], if neither `config` nor `policy` sets them.
            expert: True adds the expert's label at every step.
            reward: Weights of the reward.

        Raises:
            ReadygoError: If scene, avatars or settings cannot be used.
        """
        try:
            self._split = Split(split)
            spec = None if policy is None else load_spec(Path(policy))
            settings = _settings(None if config is None else Path(config), spec, humans, image_px)
        except ValueError as error:
            raise ConfigError(str(error)) from error
        place = Path(avatars) if avatars is not None else avatars_of_policy(spec) if spec is not None else None
        self._world = evaluation_world(scene, settings, avatars=place, seed=0, split=self._split)
        self._evaluator = make_evaluator(self._world, renderer=self._world.renderer())
        self._source, self._eyes = self._evaluator.source(), self._evaluator.eyes()
        self._task = Task.STATIC if humans == 0 else Task.REACTIVE if reactive else Task.DYNAMIC
        self._expert, self._reward = expert, reward or Reward()

    @property
    def robot(self) -> RobotConfig:
        """The robot of the task."""
        return self._world.config.robot

    def begin(self, seed: int, indices: "itertools.count[int]") -> NavEpisode:
        """Begin the next valid episode of a seed.

        Raises:
            SceneError: If scenario after scenario is rejected.
        """
        keys = (EpisodeKey(seed=seed, split=self._split, index=index) for index in indices)
        episode, _ = self._source.next_accepted(keys)
        return self._start(episode.scenario.episode, self._evaluator.simulation(as_task(episode, self._task)))

    def observe(self, episodes: Sequence[NavEpisode]) -> dict[str, AnyArray]:
        """Observations of the robots: `rgb` (B, H, W, 3), `goal` (B, 2) [m], `velocity` (B, 2) [m/s, rad/s]."""
        simulations = [episode.simulation for episode in episodes]
        return {
            "rgb": self._eyes.look(simulations),
            "goal": np.array([simulation.goal_xy_robot_m for simulation in simulations], np.float32),
            "velocity": np.array([(s.v_mps, s.w_radps) for s in simulations], np.float32),
        }

    def advance(self, episode: NavEpisode, action: npt.ArrayLike) -> tuple[float, bool, bool]:
        """Advance an episode by one step.

        Args:
            episode: The episode.
            action: Command v [m/s], w [rad/s], shape (2,); the robot's limits apply.

        Returns:
            Reward; True if the episode ended by success or collision; True if it ended by the time limit.
        """
        v_mps, w_radps = np.asarray(action, np.float64).tolist()
        episode.run.advance((v_mps, w_radps))
        outcome = episode.simulation.outcome
        ended = outcome is not None and outcome is not Outcome.TIMEOUT
        return episode.reward.value, ended, outcome is Outcome.TIMEOUT

    def info(self, episode: NavEpisode) -> dict[str, Any]:
        """Costs of the latest step, and privileged information."""
        simulation, outcome = episode.simulation, episode.simulation.outcome
        places = simulation.human_xy_m
        distance_m = min((math.dist((simulation.x_m, simulation.y_m), place) for place in places), default=math.inf)
        info: dict[str, Any] = {
            "cost_collision": float(_is_collision(outcome)),
            "cost_intrusion": float(distance_m - simulation.contact_m < PERSONAL_SPACE_M),
            "success": outcome is Outcome.SUCCESS,
            "outcome": "" if outcome is None else outcome.value,
            "way_left_m": episode.reward.left_m,
            "human_distance_m": distance_m,
            "episode": episode.key.episode_id,
        }
        if episode.expert is not None:
            info["expert_command"] = self._command(episode)
        return info

    def _command(self, episode: NavEpisode) -> Float32Array:
        """The expert's command in the current state; zeros after the end of the episode."""
        assert episode.expert is not None
        if episode.simulation.outcome is not None:
            return np.zeros(2, np.float32)
        decision = episode.expert.act(episode.simulation)
        return np.array([decision.v_mps, decision.w_radps], np.float32)

    def _start(self, key: EpisodeKey, simulation: EpisodeSimulation) -> NavEpisode:
        planner, reward = self._world.robot_planner, RewardObserver(self._reward)
        expert = planner.expert(simulation.scenario, simulation.motions) if self._expert else None
        return NavEpisode(key, EpisodeRun(simulation, [reward]), reward, expert)


def _settings(path: Path | None, policy: PolicySpec | None, humans: int, image_px: tuple[int, int]) -> RunConfig:
    settings = load_run_config(path, base=None if policy is None else settings_of_policy(policy))
    count = max(humans, 1)
    episode = dataclasses.replace(settings.episode, human_count_min=count, human_count_max=count)
    robot = settings.robot
    if robot.ranges.varies:
        raise ConfigError("Actions of an environment are those of one robot: leave [ranges] of the robot out.")
    if path is None and policy is None:
        camera = dataclasses.replace(robot.camera, height_px=image_px[0], width_px=image_px[1])
        robot = dataclasses.replace(robot, camera=camera)
    return dataclasses.replace(settings, episode=episode, robot=robot)


def _is_collision(outcome: Outcome | None) -> bool:
    return outcome in (Outcome.HUMAN_COLLISION, Outcome.STATIC_COLLISION)
