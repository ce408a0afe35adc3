"""One evaluation: request -> reply."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from readygo.common.bus import Bus
from readygo.common.episode import EpisodeConfig
from readygo.common.episode.metrics import TaskSummary
from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.errors import PolicyError
from readygo.common.maps import FloorMap, OccupancyMap
from readygo.common.messages import RobotPlanRequest, RobotTrajectory, Split, topics
from readygo.common.policy import Policy, check_policy_camera
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import RATE_HZ
from readygo.services.evaluator.config import EvaluatorConfig
from readygo.services.evaluator.drivers import Driver, Method, PolicyDriver, StraightLineDriver
from readygo.services.evaluator.episodes import EpisodeSource, MatchedEpisode, Task
from readygo.services.evaluator.eyes import Eyes
from readygo.services.evaluator.records import EpisodeRecord, make_record, summarize_records
from readygo.services.evaluator.results import Results
from readygo.services.evaluator.rollout import roll_out

Report = Callable[[EpisodeRecord], None]


@dataclass(frozen=True, kw_only=True)
class EvaluateRequest:
    """Which methods to drive through which episodes."""

    tasks: tuple[Task, ...] = (Task.STATIC, Task.DYNAMIC)
    methods: tuple[Method, ...] = (Method.POLICY, Method.EXPERT, Method.STRAIGHT_LINE)
    episodes: int = 100
    """Episodes per task."""
    seed: int = 0
    split: Split = Split.TEST
    control_hz: float = RATE_HZ
    """How often the policy decides [Hz]; its command is held in between. A step is 0.05 s: 20, 10, 5, 4, 2 or 1 Hz."""

    def __post_init__(self) -> None:
        if not self.tasks or not self.methods or self.episodes < 1 or self.seed < 0:
            raise ValueError("an evaluation needs a task, a method, one or more episodes and a seed >= 0.")
        if len(set(self.tasks)) < len(self.tasks) or len(set(self.methods)) < len(self.methods):
            raise ValueError("tasks and methods must not repeat.")
        steps = RATE_HZ / self.control_hz if self.control_hz > 0 else 0.0
        if steps < 1 or steps != round(steps):
            raise ValueError(f"control_hz must be {RATE_HZ} Hz divided by a whole number, got {self.control_hz:g}.")

    @property
    def hold_steps(self) -> int:
        """Steps from one decision of the policy to the next."""
        return round(RATE_HZ / self.control_hz)


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluateReply:
    """Records by task, method and episode, and their scores."""

    records: tuple[EpisodeRecord, ...]
    summaries: dict[tuple[Task, Method], TaskSummary]
    skipped: int
    """Indices that the planner or the animator rejected before anybody drove."""
    episodes: tuple[MatchedEpisode, ...] = ()
    """What was driven through."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluator:
    """What an evaluation needs besides the services on the bus."""

    bus: Bus
    """Serves "human-plan", "animate", "robot-plan" and a renderer."""
    robot: RobotConfig
    robot_map: OccupancyMap
    floor: FloorMap
    episode_config: EpisodeConfig = field(default_factory=EpisodeConfig)
    config: EvaluatorConfig = field(default_factory=EvaluatorConfig)
    policy: Policy | None = None
    camera: Literal["policy", "robot"] = "policy"
    """"robot" lets the policy look through another camera than the one that it was trained with."""

    def __post_init__(self) -> None:
        if self.policy is not None and self.camera == "policy":
            check_policy_camera(self.policy.spec, self.robot)


def handle_evaluate(
    evaluator: Evaluator, request: EvaluateRequest, *, report: Report | None = None, results: Results | None = None
) -> EvaluateReply:
    """Drive every method through the same episodes.

    Args:
        evaluator: Scene, robot, policy and bus.
        request: What to drive.
        report: Told about every episode that ends, and of those that had ended before.
        results: Keeps every episode as it ends; those that it has are not driven again.

    Raises:
        RunError: If an episode cannot be kept.
        PolicyError: If a policy is asked for and none is loaded.
        SceneError: If the scene yields no episodes.
        BusError: If a service does not answer.
    """
    if Method.POLICY in request.methods and evaluator.policy is None:
        raise PolicyError("No policy is given; give its folder, or leave the method `policy` out.")
    source = EpisodeSource(
        evaluator.bus,
        robot=evaluator.robot,
        robot_map=evaluator.robot_map,
        episode_config=evaluator.episode_config,
        config=evaluator.config,
    )
    episodes, skipped = source.draw(seed=request.seed, split=request.split, count=request.episodes, tasks=request.tasks)
    records: list[EpisodeRecord] = []
    for task in request.tasks:
        of_task = [episode for episode in episodes if episode.task is task]
        for method in request.methods:
            driver = None if method is Method.EXPERT else _make_driver(evaluator, method, request.hold_steps)
            records += _drive_all(evaluator, method, driver, of_task, report or (lambda _: None), results)
    return EvaluateReply(
        records=tuple(records),
        summaries=summarize_records(records, time_limit_s=evaluator.episode_config.time_limit_s),
        skipped=skipped,
        episodes=tuple(episodes),
    )


def _drive_all(
    evaluator: Evaluator,
    method: Method,
    driver: Driver[Any] | None,
    episodes: Sequence[MatchedEpisode],
    report: Report,
    results: Results | None,
) -> list[EpisodeRecord]:
    """Records of one method, in the order of `episodes`; without a driver the expert is asked."""
    kept = {} if results is None else results.records
    keys = [(episode.task, method, episode.scenario.episode) for episode in episodes]
    records = {key: kept[key] for key in keys if key in kept}
    for record in records.values():
        report(record)
    missing = [episode for episode, key in zip(episodes, keys, strict=True) if key not in records]
    runs = (
        ((row, _ask_expert(evaluator, episode)) for row, episode in enumerate(missing))
        if driver is None
        else roll_out(missing, driver, _simulate_on(evaluator), lockstep=evaluator.config.lockstep)
    )
    for row, trajectory in runs:
        record = make_record(missing[row], method, trajectory, evaluator.episode_config)
        if results is not None:
            results.keep(record, trajectory)
        records[record.key] = record
        report(record)
    return [records[key] for key in keys]


def _simulate_on(evaluator: Evaluator) -> Callable[[MatchedEpisode], EpisodeSimulation]:
    """Starts simulations on the evaluator's map."""

    def simulate(episode: MatchedEpisode) -> EpisodeSimulation:
        return EpisodeSimulation(
            episode.scenario, episode.motions, evaluator.robot_map, evaluator.robot, evaluator.episode_config
        )

    return simulate


def _make_driver(evaluator: Evaluator, method: Method, hold_steps: int) -> Driver[Any]:
    if method is Method.STRAIGHT_LINE:
        return StraightLineDriver(evaluator.robot)
    assert evaluator.policy is not None
    config = evaluator.config
    eyes = Eyes(
        evaluator.bus,
        topics.render(config.renderer),
        robot=evaluator.robot,
        floor=evaluator.floor,
        timeout_s=config.request_timeout_s,
    )
    return PolicyDriver(evaluator.policy, eyes, hold_steps)


def _ask_expert(evaluator: Evaluator, episode: MatchedEpisode) -> RobotTrajectory | None:
    """The expert's run, rejected or not: a failed one counts as its failure."""
    request = RobotPlanRequest(scenario=episode.scenario, motions=episode.motions)
    timeout_s = evaluator.config.request_timeout_s
    return evaluator.bus.request(topics.ROBOT_PLAN, request, timeout_s=timeout_s).trajectory
