"""A worker's side of an evaluation: drives the missing records of a leased episode, and sends them to the keeper."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.common.bus import Bus
from readygo.common.episode.loop import Driver
from readygo.common.errors import RunError
from readygo.common.fleet import Inputs, StageResult, Work
from readygo.common.messages import (
    ClaimReply,
    DriverKind,
    DrivesRequest,
    EpisodeKey,
    EvaluationPlan,
    EvaluationPlanRequest,
    KeepRequest,
    RobotTrajectory,
    topics,
)
from readygo.common.rasterizer.warm import warm as warm_rasterizer
from readygo.common.state_policy.perceiving_driver import PerceivingStateDriver
from readygo.runs.evaluation import make_evaluator, make_evaluator_config, make_request
from readygo.runs.method_files import check_method_files
from readygo.runs.methods import named_methods, needs_renderer
from readygo.runs.shown_drives import ShownDrives
from readygo.runs.world import World
from readygo.services.evaluator import EpisodeRecord, Evaluator, MatchedEpisode, Task, as_task, drive
from readygo.services.planner import PerceivingDriver

KEEP_TIMEOUT_S = 20.0
"""Longest wait until a record is on disk [s]."""


@dataclass(frozen=True, kw_only=True)
class _Drivers:
    """The evaluator of a worker with its drivers."""

    evaluator: Evaluator
    by_method: dict[str, Driver[Any]]


def evaluation_work(world: World, bus: Bus) -> Work:
    """The work of an evaluation's only stage.

    Args:
        world: The evaluation's world.
        bus: Bus with the evaluation's keeper.

    Raises:
        ReadygoError: If a method's files differ on this machine, or a method cannot be made.
    """
    plan = bus.request(topics.EVALUATION_PLAN, EvaluationPlanRequest(), timeout_s=KEEP_TIMEOUT_S)
    made = _make_drivers(world, plan)
    for driver in made.by_method.values():
        if isinstance(driver, PerceivingDriver):
            driver.on_look = ShownDrives(bus, world.scene.maps.floor, DriverKind.EXPERT)
        elif isinstance(driver, PerceivingStateDriver):
            driver.on_look = ShownDrives(bus, world.scene.maps.floor, DriverKind.POLICY)

    def work(claim: ClaimReply, inputs: Inputs) -> StageResult | None:
        assert claim.episode is not None
        index, attempt = claim.episode.index, claim.attempt
        request = DrivesRequest(index=index, attempt=attempt)
        missing = bus.request(topics.EVALUATION_DRIVES, request, timeout_s=KEEP_TIMEOUT_S).drives
        drives = [(Task(drive.task), drive.method) for drive in missing]
        for record, trajectory in _drive_tasks(made, claim.episode, drives):
            kept = KeepRequest(index=index, attempt=attempt, record=record.to_mapping(), trajectory=trajectory)
            bus.request(topics.EVALUATION_KEEP, kept, timeout_s=KEEP_TIMEOUT_S)
        return None

    return work


def _make_drivers(world: World, plan: EvaluationPlan) -> _Drivers:
    checkpoints = Path(plan.checkpoints)
    check_method_files(plan.method_hashes, plan.methods, checkpoints)
    request = make_request(1, plan.tasks, plan.methods, world.spec.split, world.spec.seed, control_hz=plan.control_hz)
    looks, hold_steps = (
        needs_renderer(plan.methods, Path(plan.checkpoints)),
        request.hold_steps(world.config.robot.clock),
    )
    if looks:
        # One of the starting workers compiles while the others wait.
        warm_rasterizer()
    evaluator = make_evaluator(
        world,
        renderer=world.renderer() if looks else None,
        policy=world.policy(world.spec.policy) if world.spec.policy else None,
        evaluator_config=make_evaluator_config(plan.lockstep),
        camera="robot" if plan.camera == "robot" else "policy",
        methods=named_methods(world, plan.methods, checkpoints, hold_steps),
    )
    drivers = {method: evaluator.driver(method, hold_steps) for method in plan.methods}
    return _Drivers(evaluator=evaluator, by_method=drivers)


def _drive_tasks(
    made: _Drivers, key: EpisodeKey, drives: list[tuple[Task, str]]
) -> Iterator[tuple[EpisodeRecord, RobotTrajectory]]:
    """Drive the tasks of an episode in parallel, one method after the other."""
    if not drives:
        return
    dynamic = _episode(made.evaluator, key)
    for method in dict.fromkeys(method for _, method in drives):
        episodes = [as_task(dynamic, task) for task, of_method in drives if of_method == method]
        yield from drive(made.evaluator, method, made.by_method[method], episodes)


def _episode(evaluator: Evaluator, key: EpisodeKey) -> MatchedEpisode:
    episode, reason = evaluator.source().among_humans(key)
    if episode is None:
        raise RunError(f"Episode {key.episode_id} is rejected here ({reason}), and was not where the evaluation began.")
    return episode
