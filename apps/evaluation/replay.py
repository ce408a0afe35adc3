"""Replays of an evaluation's episodes by their saved commands: on the map, in images, as videos."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from readygo.apps.pictures.film import write_film
from readygo.apps.pictures.plan_film import RobotView, run_film
from readygo.apps.report.page import StripImage
from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.drawing import plan_view
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure, run_episode
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, EpisodeMotions, Outcome, RobotTrajectory
from readygo.common.perception import Perception
from readygo.common.perception.episode import EpisodePerception
from readygo.runs.methods import PERCEIVE_AND_ACT, PERCEIVE_AND_PLAN
from readygo.runs.world import World
from readygo.services.evaluator import EXPERT, EpisodeRecord, MatchedEpisode, RecordKey, Results, Simulate, Task
from readygo.services.planner import (
    DrivenRun,
    draw_ways,
    episode_view,
    run_beside_expert,
    run_with_journal,
)
from readygo.services.renderer import Renderer

PERCEIVING = (PERCEIVE_AND_PLAN, PERCEIVE_AND_ACT)
"""Methods whose network looks at the replayed images again."""
MAP_PX = (460, 330)
"""Largest width and height of an episode's map on a page."""
STRIP_PX = 480
"""Approximate width of several cameras' images together in a strip [px]."""
BEFORE_END_S = (4.0, 3.0, 2.0, 1.0, 0.5, 0.0)
"""Times of the images in the strip of a collision, before its end [s]."""


class _ReplayDriver:
    """Driver that repeats the recorded commands of an episode."""

    looks = False

    def __init__(self, record: EpisodeRecord, actions: Float64Array) -> None:
        self._record, self._actions = record, actions

    def start(self, simulation: EpisodeSimulation) -> None:
        """Begin an episode; a replay has no memory."""

    def act(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[Command | DriverFailure]:
        """The recorded command of each running episode at its current step."""
        return [self._command(simulation) for simulation, _ in running]

    def _command(self, simulation: EpisodeSimulation) -> Command:
        if simulation.step >= len(self._actions):
            raise _another_way(self._record)
        v_mps, w_radps = self._actions[simulation.step].tolist()
        # The record holds the executed motion of every step, not the command of each decision.
        simulation.hold(v_mps, w_radps)
        return v_mps, w_radps


class Replays:
    """Replays the episodes of an evaluation."""

    def __init__(
        self,
        world: World,
        results: Results,
        episodes: Sequence[MatchedEpisode],
        renderer: Renderer | None,
        simulate: Simulate,
        *,
        sees: Sequence[str] = (),
        perception: Perception | None = None,
    ) -> None:
        """Prepare replays.

        Args:
            world: World of the evaluation.
            results: Saved results of the evaluation.
            episodes: Episodes that were driven.
            renderer: Renderer of the world; if None, one is made when it is needed.
            simulate: Starts an episode, as in the evaluation.
            sees: Images that the policy uses; they are shown beside the recorded ones.
            perception: Network of the methods `PERCEIVING`.
        """
        self.world, self.folder, self._results = world, results.folder, results
        self._episodes: Mapping[tuple[Task, EpisodeKey], MatchedEpisode] = {
            (episode.task, episode.scenario.episode): episode for episode in episodes
        }
        self._made_renderer, self._simulate, self._sees = renderer, simulate, sees
        self._perception = perception
        self._walked: dict[RecordKey, EpisodeMotions] = {}
        """Motions of reactive humans in replayed episodes."""
        self._actions: dict[RecordKey, Float64Array] = {}

    def load(self, records: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
        """Read the saved commands of some episodes, and return the episodes that have them."""
        self._actions |= self._results.actions([record.key for record in records if record.key not in self._actions])
        return [record for record in records if record.key in self._actions]

    def episode(self, record: EpisodeRecord) -> MatchedEpisode:
        """Start, goal and humans of an episode; after a call of `trajectory`, with the humans' replayed motions."""
        episode = self._episodes[record.task, record.episode]
        walked = self._walked.get(record.key)
        return episode if walked is None else dataclasses.replace(episode, motions=walked)

    def trajectory(self, record: EpisodeRecord) -> RobotTrajectory:
        """The robot's trajectory in an episode.

        Raises:
            RunError: If the replay differs from the record.
        """
        simulation = self._simulate(self._episodes[record.task, record.episode])
        run_episode(simulation, self._driver(record))
        walked = simulation.motions_so_far()
        if walked is not simulation.motions:
            self._walked[record.key] = walked
        return self._check_replay(record, simulation.trajectory())

    def meets_human(self, record: EpisodeRecord, other: EpisodeRecord) -> bool:
        """True if the robot meets a human in an episode when it drives by the commands of another one.

        Args:
            record: The episode.
            other: That of the commands, between the same start and goal; loaded before.
        """
        simulation = self._simulate(self._episodes[record.task, record.episode])
        run_episode(simulation, self._driver(other))
        return simulation.outcome is Outcome.HUMAN_COLLISION

    def draw(self, record: EpisodeRecord, trajectory: RobotTrajectory) -> UInt8Array:
        """The map with the trajectories of robot and humans."""
        episode = self.episode(record)
        scenario, motions = episode.scenario, episode.motions
        planner = self.world.robot_planner.of(scenario.episode)
        view = episode_view(planner.maps.robot, scenario, trajectory, motions=motions, size_px=MAP_PX)
        picture = view.rgb.copy()
        draw_ways(picture, view, scenario, trajectory, motions, planner.robot, planner.episode_config)
        plan_view.draw_scale_bar(picture, view)
        return picture

    def strip(self, record: EpisodeRecord, trajectory: RobotTrajectory) -> list[StripImage]:
        """Camera images of an episode: the last seconds before a collision, else the whole episode."""
        episode = self.episode(record)
        look = RobotView(
            self._renderer, episode.scenario, episode.motions, trajectory, sees=self._sees, width_px=STRIP_PX
        )
        return [StripImage(time_s=step * trajectory.dt_s, rgb=look(step)) for step in strip_steps(trajectory)]

    def film(self, path: Path, record: EpisodeRecord) -> None:
        """Write a video of an episode: the robot's camera images beside the map.

        Raises:
            RunError: If the replay differs from the record.
            ReadygoError: If the video cannot be written.
        """
        run = self.run(record)
        planner = self.world.robot_planner.of(run.scenario.episode)
        write_film(path, run_film(planner, run, self.view(run)))

    def run(self, record: EpisodeRecord) -> DrivenRun:
        """Replay an episode, with the expert's knowledge and labels.

        Raises:
            RunError: If the replay differs from the record.
        """
        self.trajectory(record)
        episode = self.episode(record)
        scenario, motions = episode.scenario, episode.motions
        planner = self.world.robot_planner.of(scenario.episode)
        if record.method == EXPERT and record.key not in self._walked:
            run = run_with_journal(planner, scenario, motions)
        else:
            run = run_beside_expert(planner, scenario, motions, self._driver(record), record.method)
        self._check_replay(record, run.trajectory)
        return run

    def view(self, run: DrivenRun) -> RobotView:
        """The view of the robot's cameras in an episode, with what its driver perceived."""
        perception = None
        if self._perception is not None and run.driver in PERCEIVING:
            planner = self.world.robot_planner.of(run.scenario.episode)
            _, people = planner.tracked_expert(run.scenario)
            perception = EpisodePerception(self._perception, people, planner.robot)
        return RobotView(
            self._renderer, run.scenario, run.motions, run.trajectory, sees=self._sees, perception=perception
        )

    @cached_property
    def _renderer(self) -> Renderer:
        return self._made_renderer or self.world.renderer()

    def _driver(self, record: EpisodeRecord) -> "_ReplayDriver":
        return _ReplayDriver(record, self._actions[record.key])

    def _check_replay(self, record: EpisodeRecord, trajectory: RobotTrajectory) -> RobotTrajectory:
        same_end = abs(trajectory.duration_s - record.result.duration_s) < trajectory.dt_s / 2
        if trajectory.outcome is not record.result.outcome or not same_end:
            raise _another_way(record)
        return trajectory


def strip_steps(trajectory: RobotTrajectory) -> list[int]:
    """The steps that a strip shows: the last seconds before a collision, else steps of the whole episode."""
    step_count = len(trajectory.xyyaw)
    if trajectory.outcome in (Outcome.HUMAN_COLLISION, Outcome.STATIC_COLLISION):
        steps = [step_count - 1 - round(before_s * trajectory.rate_hz) for before_s in BEFORE_END_S]
    else:
        steps = np.linspace(0, step_count - 1, len(BEFORE_END_S)).round().astype(int).tolist()
    return sorted({max(step, 0) for step in steps})


def _another_way(record: EpisodeRecord) -> RunError:
    return RunError(
        f"Episode {record.episode.episode_id} goes differently now than when it was evaluated: this version or machine "
        "drives differently. Evaluate into a new folder with --out."
    )
