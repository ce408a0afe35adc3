"""One evaluation: request -> reply."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from readygo.common.bus import Bus
from readygo.common.camera.view import FieldOfView, in_view, view_of
from readygo.common.episode import EpisodeConfig
from readygo.common.episode.conduct import Sees
from readygo.common.episode.loop import Driver, run_episodes
from readygo.common.episode.metrics import TaskSummary
from readygo.common.episode.robot import robot_of_episode
from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.errors import PolicyError, RunError
from readygo.common.images.names import RGB
from readygo.common.maps import FloorMap, OccupancyMap, SightMap, sight_of_occupancy
from readygo.common.messages import RobotTrajectory, Split, topics
from readygo.common.policy import Policy, check_policy_camera
from readygo.common.policy.driver import PolicyDriver
from readygo.common.robot import Clock, RobotConfig
from readygo.services.evaluator.config import EvaluatorConfig
from readygo.services.evaluator.drivers import EXPERT, POLICY, STRAIGHT_LINE, StraightLineDriver
from readygo.services.evaluator.episodes import REQUEST_TIMEOUT_S, EpisodeSource, MatchedEpisode, Simulate, Task
from readygo.services.evaluator.eyes import Eyes
from readygo.services.evaluator.records import EpisodeRecord, RecordKey, make_record, summarize_records
from readygo.services.evaluator.results import Results

Report = Callable[[EpisodeRecord], None]
MakeDriver = Callable[["Evaluator"], Driver[Any]]
"""Makes the driver of one method."""
Elsewhere = Callable[[Sequence[int]], None]
"""Has other processes drive the episodes of some indices."""

RENDERER = "0"
"""Name of the renderer that is asked for images."""
VIEW_RANGE_M = 10.0
"""Farther humans do not count as seen [m]."""


@dataclass(frozen=True, kw_only=True)
class EvaluateRequest:
    """Which methods to drive through which episodes."""

    tasks: tuple[Task, ...] = (Task.STATIC, Task.DYNAMIC)
    methods: tuple[str, ...] = (POLICY, EXPERT, STRAIGHT_LINE)
    episodes: int = 100
    """Episodes per task."""
    seed: int = 0
    split: Split = Split.TEST
    control_hz: float | None = None
    """How often the policy decides [Hz]; its command is held in between. None: as often as the robot is commanded."""

    def __post_init__(self) -> None:
        if not self.tasks or not self.methods:
            raise ValueError("an evaluation needs a task and a method.")
        for name, least in (("episodes", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}, got {getattr(self, name)}.")
        if len(set(self.tasks)) < len(self.tasks) or len(set(self.methods)) < len(self.methods):
            raise ValueError("tasks and methods must not repeat.")

    def hold_steps(self, clock: Clock) -> int:
        """Steps from one decision of the policy to the next.

        Raises:
            RunError: If the rate is not the robot's divided by a whole number.
        """
        own_hz = clock.rate_hz / clock.control_every
        held = (
            own_hz / self.control_hz
            if self.control_hz is not None and self.control_hz > 0
            else float(self.control_hz is None)
        )
        if not (held >= 1 and held == round(held)):
            raise RunError(f"control_hz must be {own_hz:g} Hz divided by a whole number, got {self.control_hz:g}.")
        return clock.control_every * round(held)


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluateReply:
    """Records by task, method and episode, and their scores."""

    records: tuple[EpisodeRecord, ...]
    summaries: dict[tuple[Task, str], TaskSummary]
    skipped: int
    """Number of indices that the planner or the animator rejected before any method drove."""
    episodes: tuple[MatchedEpisode, ...] = ()
    """The episodes that were driven."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluator:
    """What an evaluation needs besides the services on the bus."""

    bus: Bus
    """Serves "human-plan", "animate" and a renderer."""
    robot: RobotConfig
    """Each episode has one of its ranges, if it has any."""
    robot_map: OccupancyMap
    floor: FloorMap
    episode_config: EpisodeConfig = field(default_factory=EpisodeConfig)
    config: EvaluatorConfig = field(default_factory=EvaluatorConfig)
    policy: Policy | None = None
    camera: Literal["policy", "robot"] = "policy"
    """"robot" lets the policy look through another camera than the one that it was trained with."""
    drivers: Mapping[str, MakeDriver] = field(default_factory=dict)
    """Methods besides the policy and the straight line, by name."""
    simulate: Simulate | None = None
    """Starts an episode; None for humans that keep to their motions."""
    find_sight: Callable[[], SightMap] | None = None
    """What hides humans from the camera; None takes the robot's map for that."""

    def __post_init__(self) -> None:
        if self.policy is not None and self.camera == "policy":
            check_policy_camera(self.policy.spec, self.robot)

    def source(self) -> EpisodeSource:
        """Source of its episodes."""
        return EpisodeSource(
            self.bus,
            robot=self.robot,
            robot_map=self.robot_map,
            episode_config=self.episode_config,
        )

    def simulation(self, episode: MatchedEpisode) -> EpisodeSimulation:
        """An episode at its start."""
        if self.simulate is not None:
            return self.simulate(episode)
        robot = robot_of_episode(self.robot, episode.scenario.episode)
        return EpisodeSimulation(episode.scenario, episode.motions, self.robot_map, robot, self.episode_config)

    def eyes(self, sees: tuple[str, ...] = (RGB,)) -> Eyes:
        """Camera images for a driver.

        Args:
            sees: Images, see `readygo.common.policy.sight`.
        """
        return Eyes(
            self.bus,
            topics.render(RENDERER),
            robot=self.robot,
            floor=self.floor,
            timeout_s=REQUEST_TIMEOUT_S,
            sees=sees,
        )

    def driver(self, method: str, hold_steps: int = 1) -> Driver[Any]:
        """The driver of a method.

        Args:
            method: Name of the method.
            hold_steps: Steps from one decision of the policy to the next.

        Raises:
            PolicyError: If it is the policy's and there is none.
            RunError: If there is no such method.
        """
        if method == POLICY:
            if self.policy is None:
                raise PolicyError("No policy is given; give its folder, or leave the method `policy` out.")
            return PolicyDriver(self.policy, self.eyes(self.policy.spec.images), hold_steps)
        if method == STRAIGHT_LINE:
            return StraightLineDriver()
        if method not in self.drivers:
            known = ", ".join((POLICY, STRAIGHT_LINE, *self.drivers))
            raise RunError(
                f"There is no method {method!r}; there are {known}, policies in the folder of "
                "--checkpoints, and yours as my_package:MyDriver."
            )
        return self.drivers[method](self)

    def check_drivers(self, request: EvaluateRequest) -> None:
        """Raise what `driver` raises for a method of a request, before anything is written."""
        for method in request.methods:
            self.driver(method, request.hold_steps(self.robot.clock))


def handle_evaluate(
    evaluator: Evaluator,
    request: EvaluateRequest,
    *,
    report: Report | None = None,
    results: Results | None = None,
    elsewhere: Elsewhere | None = None,
) -> EvaluateReply:
    """Drive every method through the same episodes.

    Args:
        evaluator: Scene, robot, policy and bus.
        request: What to drive.
        report: Told about every episode that ends, and of those that had ended before.
        results: Keeps every episode as it ends; those that it has are not driven again.
        elsewhere: Drives the missing episodes into `results` instead of this process.

    Raises:
        RunError: If an episode cannot be kept, or there is no such method.
        PolicyError: If a policy is asked for and none is loaded.
        SceneError: If the scene yields no episodes.
        BusError: If a service does not answer.
    """
    report = report or (lambda _: None)
    # Errors in a method are reported before any episode is driven.
    hold_steps = request.hold_steps(evaluator.robot.clock)
    drivers = {method: evaluator.driver(method, hold_steps) for method in request.methods}
    episodes, skipped = evaluator.source().draw(
        seed=request.seed, split=request.split, count=request.episodes, tasks=request.tasks
    )
    # By task, then by method, regardless of the order of driving.
    places = [
        (episode, (task, method, episode.scenario.episode))
        for task in request.tasks
        for method in request.methods
        for episode in episodes
        if episode.task is task
    ]
    kept = {} if results is None else results.records
    records = {key: kept[key] for _, key in places if key in kept}
    for record in records.values():
        report(record)
    missing = [place for place in places if place[1] not in records]
    if elsewhere is not None and results is not None:
        if missing:
            elsewhere(sorted({episode.scenario.episode.index for episode, _ in missing}))
        records = results.records
    else:
        for record in _drive_here(evaluator, drivers, missing, results):
            records[record.key] = record
            report(record)
    found = tuple(records[key] for _, key in places)
    return EvaluateReply(
        records=found,
        summaries=summarize_records(found, time_limit_s=evaluator.episode_config.time_limit_s),
        skipped=skipped,
        episodes=tuple(episodes),
    )


def drive(
    evaluator: Evaluator, method: str, driver: Driver[Any], episodes: Sequence[MatchedEpisode]
) -> Iterator[tuple[EpisodeRecord, RobotTrajectory]]:
    """Drive one method through episodes, side by side where it looks.

    Args:
        evaluator: Scene, robot, policy and bus.
        method: Name of the method.
        driver: Its driver, from `Evaluator.driver`.
        episodes: Episodes to drive through.

    Yields:
        How it did, and what the robot did, in the order in which episodes end.
    """
    lockstep = evaluator.config.lockstep if driver.looks else 1
    simulations = (evaluator.simulation(episode) for episode in episodes)
    for run in run_episodes(simulations, driver, lockstep=lockstep):
        sees = _sees(evaluator, run.simulation.robot)
        yield make_record(episodes[run.row], method, run.simulation, sees, run.failure), run.simulation.trajectory()


def _drive_here(
    evaluator: Evaluator,
    drivers: Mapping[str, Driver[Any]],
    missing: Sequence[tuple[MatchedEpisode, RecordKey]],
    results: Results | None,
) -> Iterator[EpisodeRecord]:
    """Records of what is missing, as they are kept."""
    groups: dict[tuple[Task, str], list[MatchedEpisode]] = {}
    for episode, (task, method, _) in missing:
        groups.setdefault((task, method), []).append(episode)
    for (_, method), episodes in groups.items():
        for record, trajectory in drive(evaluator, method, drivers[method], episodes):
            if results is not None:
                results.keep(record, trajectory)
            yield record


def _sees(evaluator: Evaluator, robot: RobotConfig) -> Sees:
    """Whether a camera of the robot shows a human, regardless of what the robot's driver looks at."""
    eyes = [(camera, view_of(camera)) for camera in robot.all_cameras.values()]
    find_sight = evaluator.find_sight or (lambda: sight_of_occupancy(evaluator.robot_map))

    def shows(eye: tuple[float, float, float], view: FieldOfView, human_m: tuple[float, float]) -> bool:
        # An arm at the border of the image is not enough: the middle of the body counts.
        inside = in_view(eye, *human_m, view, VIEW_RANGE_M, 0.0)
        return inside and find_sight().sees(eye[0], eye[1], view.height_m, human_m)

    return lambda pose, human_m: any(shows(camera.eye(*pose), view, human_m) for camera, view in eyes)
