"""What a policy could learn if it were given what its images have to tell: the ablation of seeing.

    python -m experiments.policy.given_state SCENE [--output weighed] [--caution 9] [--drive-caution 0 3 9 18]

A small network learns on-policy (DAgger: it drives, the expert says at every state what it would do) without images: it
is given free distances within the camera's view, the goal, its speeds, and places and velocities of the humans that the
expert knows of. What it fails at is no matter of seeing. Outputs, bins and risks are those of the trainer's network.

Prints one line of JSON for the expert and for each caution: successes on the first episodes of the split val, with and
without their humans, outcomes, average reaching time [s] (a failure counts as the time limit), and the mean change of
the turn rate [rad/s per s].

Source: Ross, Gordon and Bagnell, A reduction of imitation learning and structured prediction to no-regret online
learning, 2011.
"""

import argparse
import dataclasses
import itertools
import json
import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from experiments.planning.imitation import RAY_M, RAYS, Eyes
from readygo.common.arrays import Float32Array, UInt8Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure, Observer
from readygo.common.episode.metrics import wilson_interval
from readygo.common.frames import goal_in_robot_frame
from readygo.common.messages import (
    EpisodeMotions,
    Outcome,
    RobotTrajectory,
    Scenario,
    Split,
)
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import COMMAND_COUNT
from readygo.common.robot.kinematics import DT_S
from readygo.runs.config import RunConfig
from readygo.runs.scenarios import accepted_scenarios
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.runs.world import World
from readygo.services.driver import EpisodeDrive, RiskMap, drive
from readygo.services.planner import Expert
from readygo.services.trainer import best_recipe
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.model import CAUTION, bins_of, weigh
from readygo.services.trainer.objective import risks_loss

HUMANS, HUMAN_WIDTH = 2, 7
"""The nearest humans that it is given, and the numbers that tell of each."""
FORGOTTEN_S = 1.0
"""Humans that were seen longer ago are not given [s]."""
EVERY = 2
"""Steps of 0.05 s between samples of an episode."""
STATIC_SHARE, EXPERT_SHARE = 0.3, 0.1
"""Shares of the training episodes: without humans, and driven by the expert after the first round."""
AHEAD_STEPS = RobotConfig().clock.steps(best_recipe().sampling.ahead_s)
"""How far ahead the command is that a state teaches, as in the recipe `best`."""
WIDTHS, BATCH, RATE, EMA_DECAY, RISKS_WEIGHT = (512, 256), 512, 1e-3, 0.995, 4.0

Episode = tuple[Scenario, EpisodeMotions]


class Course:
    """A scene with its episodes, and the expert in it."""

    def __init__(self, scene: str, avatars: Path | None, seed: int) -> None:
        """Open the scene.

        Args:
            scene: Scene bundle, "embedded", or "embedded:SEED".
            avatars: Avatar file or folder of them; None takes the embedded ones.
            seed: Seed of the episodes.
        """
        config = RunConfig()
        spec = make_spec(open_scene(scene), avatars, config, seed=seed, split=Split.TRAIN, static=False)
        world = World(spec)
        self.planner, self._seed = world.robot_planner, seed
        self.weigher = RiskMap(self.planner.maps.robot)
        self.eyes = Eyes(self.planner.maps.robot, config.robot.camera, config.episode.human_radius_m)
        self._humans, self._animator = world.human_planner(), world.animator()

    def episodes(self, split: Split) -> Iterator[Episode]:
        """The episodes of a split that can be played, in order, without end."""
        return accepted_scenarios(self._humans, self._animator, self._seed, split, itertools.count())


class Senses(Observer):
    """Observes the state, instead of a camera that takes images."""

    def __init__(self, eyes: Eyes, expert: Expert) -> None:
        self._eyes, self._expert = eyes, expert
        self.told: list[Float32Array] = []
        """What was told at each step so far."""

    def step(self, simulation: EpisodeSimulation) -> None:
        """Note rays, goal, speeds and humans, shape (inputs,)."""
        rays = np.exp(-0.5 * RAY_M * np.array(self._eyes.rays((simulation.x_m, simulation.y_m, simulation.yaw_rad))))
        x, y = simulation.goal_xy_robot_m
        away_m = math.hypot(x, y)
        goal = [x / 10, y / 10, x / away_m, y / away_m, math.exp(-away_m / 2)]
        self.told.append(
            np.array([*rays, *goal, simulation.v_mps, simulation.w_radps, *self._known_humans(simulation)], np.float32)
        )

    def _known_humans(self, simulation: EpisodeSimulation) -> list[float]:
        """Presence, place, velocity, nearness and direction of the nearest humans in the robot's frame."""
        found = []
        cos, sin = math.cos(simulation.yaw_rad), math.sin(simulation.yaw_rad)
        for human in self._expert.act(simulation).perceived:
            place = np.array([human.x_m, human.y_m])
            x, y = goal_in_robot_frame(simulation.x_m, simulation.y_m, simulation.yaw_rad, place)
            vx, vy = cos * human.vx_mps + sin * human.vy_mps, cos * human.vy_mps - sin * human.vx_mps
            away_m = math.hypot(x, y)
            if human.age_s <= FORGOTTEN_S:
                found.append((away_m, [1.0, x / 4, y / 4, vx, vy, math.exp(-away_m / 1.5), y / max(away_m, 1e-6)]))
        rows = [row for _, row in sorted(found)[:HUMANS]] + [[0.0] * HUMAN_WIDTH] * HUMANS
        return [value for row in rows[:HUMANS] for value in row]


class Learner:
    """The network, what it learns from, and how it drives."""

    def __init__(self, output: str, caution: float, robot: RobotConfig, seed: int) -> None:
        """New weights, a function of the seed.

        Args:
            output: Kind of output, as `NetworkConfig.output`.
            caution: Risk coefficient, as `CAUTION` of the trainer; may be changed at any time.
            robot: Whose limits are the units of commands.
            seed: Seed of weights and batches.
        """
        torch.manual_seed(seed)
        self.weighed, self.caution = output == "weighed", caution
        # All outputs but "regression" share the grid of commands whose risks are known.
        self.bins = bins_of(NetworkConfig(output=output if output == "regression" else "weighed"), robot)
        answers = COMMAND_COUNT * (3 if self.weighed else 1) if self.bins else 2
        widths = (RAYS + 7 + HUMANS * HUMAN_WIDTH, *WIDTHS)
        layers = [layer for pair in itertools.pairwise(widths) for layer in (nn.Linear(*pair), nn.ReLU())]
        self._network = nn.Sequential(*layers, nn.Linear(WIDTHS[-1], answers))
        self._average = AveragedModel(self._network, multi_avg_fn=get_ema_multi_avg_fn(EMA_DECAY))
        self._optimizer = torch.optim.AdamW(self._network.parameters(), weight_decay=1e-4)
        self._limits = np.array([robot.v_max_mps, robot.w_max_radps], np.float32)
        self._samples: list[tuple[Float32Array, Float32Array, UInt8Array]] = []

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, told: Sequence[Float32Array], driven: EpisodeDrive) -> None:
        """Take up an episode."""
        for step in range(0, len(told), EVERY):
            wanted = np.array(driven.expert_commands[step][AHEAD_STEPS], np.float32) / self._limits
            self._samples.append((told[step], wanted, np.frombuffer(driven.risks[step], np.uint8)))

    def learn(self, steps: int, rate: float) -> float:
        """Some steps of the optimizer; the mean loss."""
        told, wanted, risks = (torch.from_numpy(np.stack(column)) for column in zip(*self._samples, strict=True))
        self._optimizer.param_groups[0]["lr"] = rate
        losses = []
        for _ in range(steps):
            rows = torch.randint(len(told), (BATCH,))
            loss = self._loss(self._network(told[rows]), wanted[rows], risks[rows])
            self._optimizer.zero_grad()
            loss.backward()
            self._optimizer.step()
            self._average.update_parameters(self._network)
            losses.append(loss.item())
        return float(np.mean(losses))

    @torch.inference_mode()
    def command(self, told: Float32Array) -> tuple[float, float]:
        """The command v [m/s], w [rad/s] at a state."""
        answers = self._average(torch.from_numpy(told)[None])
        if self.bins is not None:
            answers = self.bins.mode(weigh(answers, self.caution) if self.weighed else answers)
        v, w = answers[0].tolist()
        return min(max(v, 0.0), 1.0) * float(self._limits[0]), min(max(w, -1.0), 1.0) * float(self._limits[1])

    def _loss(self, answers: Tensor, wanted: Tensor, risks: Tensor) -> Tensor:
        if self.bins is None:
            return nn.functional.mse_loss(answers, wanted)
        loss = nn.functional.cross_entropy(answers[:, :COMMAND_COUNT], self.bins.weights(wanted))
        return loss + RISKS_WEIGHT * risks_loss(answers[:, COMMAND_COUNT:], risks) if self.weighed else loss


class LearnerDriver:
    """Drives one episode by what its senses told."""

    looks = False

    def __init__(self, learner: Learner, senses: Senses) -> None:
        self._learner, self._senses = learner, senses

    def start(self, simulation: EpisodeSimulation) -> None:
        """Nothing to remember."""

    def act(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[Command | DriverFailure]:
        """Commands for one control step, as `readygo.common.episode.loop.Driver.act` returns them."""
        return [self._learner.command(self._senses.told[-1])]


def driven(course: Course, episode: Episode, learner: Learner | None) -> tuple[EpisodeDrive, list[Float32Array]]:
    """An episode that the learner drives, or else the expert, and what was told at each of its steps."""
    simulation, expert = course.planner.simulation(*episode), course.planner.expert(*episode)
    senses = Senses(course.eyes, expert)
    driver = LearnerDriver(learner, senses) if learner else None
    return drive(simulation, expert, course.weigher, driver, camera=senses), senses.told


def without_humans(episode: Episode) -> Episode:
    """The episode with the same start and goal, without humans."""
    return dataclasses.replace(episode[0], humans=()), EpisodeMotions(humans=())


def learned(course: Course, learner: Learner, *, rounds: int, samples: int, steps: int, seed: int) -> None:
    """Let the expert drive one round, then the learner, which learns after each.

    Args:
        course: Where.
        learner: Who learns.
        rounds: How often it learns.
        samples: Samples that a round adds at least.
        steps: Steps of the optimizer after a round; three times as many after the last one.
        seed: Seed of the choice of drivers and of episodes with humans.
    """
    rng, episodes = np.random.default_rng(seed), course.episodes(Split.TRAIN)
    for number in range(rounds):
        wanted = len(learner) + samples
        while len(learner) < wanted:
            episode = next(episodes)
            episode = without_humans(episode) if rng.random() < STATIC_SHARE else episode
            by_expert = rng.random() < EXPERT_SHARE or number == 0
            done, told = driven(course, episode, None if by_expert else learner)
            learner.add(told, done)
        last = number == rounds - 1
        learner.learn(steps * (3 if last else 1), RATE * (1 - 0.9 * number / rounds))


def scores(course: Course, learner: Learner | None, episodes: Sequence[Episode]) -> dict[str, Any]:
    """How the learner, or else the expert, does in episodes, without and with their humans."""
    limit_s = course.planner.episode_config.time_limit_s
    static = [driven(course, without_humans(episode), learner)[0].trajectory for episode in episodes]
    dynamic = [driven(course, episode, learner)[0].trajectory for episode in episodes]
    return {"static": summary(static, limit_s), "dynamic": summary(dynamic, limit_s)}


def summary(runs: Sequence[RobotTrajectory], limit_s: float) -> dict[str, Any]:
    """Success rate with its interval, outcomes, average reaching time [s], mean |change of w| [rad/s per s]."""
    outcomes = Counter(run.outcome for run in runs)
    successes = outcomes[Outcome.SUCCESS]
    changes = [np.abs(np.diff(run.actions[:, 1], prepend=0.0)).mean() / DT_S for run in runs]
    return {
        "success": round(100 * successes / len(runs), 1),
        "interval": [round(100 * end, 1) for end in wilson_interval(successes, len(runs))],
        "outcomes": {outcome.value: count for outcome, count in outcomes.items()},
        "art_s": round(sum(r.duration_s if r.outcome is Outcome.SUCCESS else limit_s for r in runs) / len(runs), 2),
        "turn_change_radps2": round(float(np.mean(changes)), 3),
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", help='scene bundle, "embedded" or "embedded:SEED"')
    parser.add_argument("--avatars", type=Path)
    parser.add_argument("--output", choices=("regression", "bins", "weighed"), default="weighed")
    parser.add_argument("--caution", type=float, default=CAUTION, help="while it learns")
    parser.add_argument("--drive-caution", type=float, nargs="+", help="when it is measured; as it learned by default")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--samples", type=int, default=15_000, help="per round")
    parser.add_argument("--steps", type=int, default=1500, help="of the optimizer per round")
    parser.add_argument("--episodes", type=int, default=50, help="to measure in, per task")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    course = Course(arguments.scene, arguments.avatars, arguments.seed)
    episodes = list(itertools.islice(course.episodes(Split.VAL), arguments.episodes))
    print(json.dumps({"driver": "expert", **scores(course, None, episodes)}), flush=True)
    learner = Learner(arguments.output, arguments.caution, course.planner.robot, arguments.seed)
    plan = {name: getattr(arguments, name) for name in ("rounds", "samples", "steps", "seed")}
    learned(course, learner, **plan)
    row = {"driver": arguments.output, "samples": len(learner), "cpu_s": round(time.process_time())}
    for caution in (arguments.drive_caution if learner.weighed else None) or [arguments.caution]:
        learner.caution = caution
        row["caution"] = caution if learner.weighed else None
        print(json.dumps({**row, **scores(course, learner, episodes)}), flush=True)


if __name__ == "__main__":
    main()
