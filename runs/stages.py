"""The stages of a run: for each one, the function that makes its result from a lease and the earlier results.

A new stage is one entry of `LINE` and the function that builds its work.
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from readygo.common.bus import Bus
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.goal import goal_pose
from readygo.common.episode.robot import robot_of_episode
from readygo.common.errors import RunError
from readygo.common.fleet import Inputs, StageResult, Work, append_episode, show_plan
from readygo.common.messages import (
    AnimateReply,
    AnimateRequest,
    ClaimReply,
    DriverKind,
    EpisodeMotions,
    HumanPlanReply,
    HumanPlanRequest,
    RobotPlanReply,
    RobotPlanRequest,
    Sample,
    Scenario,
    Stage,
    TeacherKind,
    decode,
    encode,
)
from readygo.common.messages.stages import ANIMATE, DRIVE, EVALUATE, HUMAN_PLAN, RENDER, ROBOT_PLAN
from readygo.common.perception.noise import PERCEIVED
from readygo.common.policy.driver import PolicyDriver
from readygo.common.rasterizer.warm import warm as warm_rasterizer
from readygo.runs.state_world import state_driver
from readygo.runs.world import World
from readygo.services.animator import handle_animate
from readygo.services.driver import Disturbance, LabellingExpert, RiskMap, StateTeacher, disturbs, drive, driver_of
from readygo.services.planner import handle_human_plan, handle_robot_plan
from readygo.services.renderer import (
    NO_PICTURE,
    LiveCamera,
    Renderer,
    described_samples,
    episode_header,
    episode_samples,
    goal_picture,
    unclear,
    with_goal_image,
)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A stage, and the function that builds its work for a run and loads scene and avatars."""

    stage: Stage
    work: Callable[[World, Bus], Work]


def stage_works(world: World, bus: Bus, role: str = "", line: Sequence[Entry] = ()) -> dict[Stage, Work]:
    """The work functions of a run's stages, later stages first: an episode is finished before the next one begins.

    Args:
        world: World of the run.
        bus: Bus of the run.
        role: Role whose stages are built; empty for all.
        line: All entries; those of `LINE` by default.

    Raises:
        RunError: If the run has no stage for the role, or one that this program does not know.
    """
    works = {entry.stage.name: entry.work for entry in (line or LINE)}
    stages = [stage for stage in reversed(world.spec.stages) if role in ("", stage.role)]
    if unknown := [stage.name for stage in stages if stage.name not in works]:
        raise RunError(
            f"The run has a stage {unknown[0]!r} that this version does not know; known: {', '.join(works)}."
        )
    if not stages:
        roles = ", ".join(dict.fromkeys(stage.role for stage in world.spec.stages))
        raise RunError(f"The run has nothing to do for a {role!r}; its stages need: {roles}.")
    return {stage: works[stage.name](world, bus) for stage in stages}


def _plan_humans(world: World, bus: Bus) -> Work:
    planner = world.human_planner()

    def work(claim: ClaimReply, inputs: Inputs) -> StageResult:
        assert claim.episode is not None
        reply = handle_human_plan(planner, HumanPlanRequest(episode=claim.episode, static=world.spec.static))
        return StageResult(result=encode(reply), rejected=reply.rejected)

    return work


def _animate(world: World, bus: Bus) -> Work:
    animator = world.animator()

    def work(claim: ClaimReply, inputs: Inputs) -> StageResult:
        reply = handle_animate(animator, AnimateRequest(scenario=_scenario(inputs)))
        return StageResult(result=encode(reply), rejected=reply.rejected)

    return work


def _plan_robot(world: World, bus: Bus) -> Work:
    planner = world.robot_planner

    def work(claim: ClaimReply, inputs: Inputs) -> StageResult:
        request = RobotPlanRequest(scenario=_scenario(inputs), motions=_motions(inputs))
        reply = handle_robot_plan(planner, request)
        if reply.trajectory is not None:
            show_plan(bus, request.scenario, reply.trajectory)
        return StageResult(result=encode(reply), rejected=reply.rejected)

    return work


def _render(world: World, bus: Bus) -> Work:
    # One of the starting renderers compiles while the others wait.
    warm_rasterizer()
    renderer = world.renderer()

    def work(claim: ClaimReply, inputs: Inputs) -> StageResult | None:
        scenario, motions = _scenario(inputs), _motions(inputs)
        trajectory = decode(RobotPlanReply, inputs[ROBOT_PLAN.name]).trajectory
        assert trajectory is not None
        if reason := unclear(renderer, scenario.episode, trajectory.xyyaw, world.config.episode):
            return StageResult(rejected=reason)
        header = episode_header(renderer, scenario, trajectory)
        samples = episode_samples(renderer, scenario, motions, trajectory)
        append_episode(bus, claim, header, _with_goal(world, renderer, scenario, samples))
        return None

    return work


def _drive(world: World, bus: Bus) -> Work:
    warm_rasterizer()
    renderer, planner, config = world.renderer(), world.robot_planner, world.config
    clock = config.robot.clock
    every = config.driver.image_every(clock)
    # If the recorded image rate is below the camera's, a policy decides only when it has a new image.
    hold_steps = None if every > clock.image_every else clock.control_every
    weigher = RiskMap(planner.maps.robot)
    labels = _labels(world)
    own = world.spec.policy if world.spec.policy and world.spec.policy.files else None
    if own:
        # Report errors of the policy before any work is claimed.
        world.policy(own)

    def work(claim: ClaimReply, inputs: Inputs) -> StageResult | None:
        scenario, motions = _scenario(inputs), _motions(inputs)
        episode, ref = scenario.episode, claim.policy or own
        driver = driver_of(episode, ref.mix if ref else 0.0)
        simulation = planner.simulation(scenario, motions)
        policy = disturbance = None
        camera = LiveCamera(renderer, image_every=every)
        if ref and driver is DriverKind.POLICY:
            loaded = world.policy(ref)
            camera = LiveCamera(renderer, loaded.spec.images, every)
            policy = PolicyDriver(loaded, camera, hold_steps)
        elif disturbs(episode, config.driver.disturbed):
            disturbance = Disturbance(episode, simulation.robot)
        driven = drive(simulation, labels(simulation), weigher, policy, disturbance, camera=camera, image_every=every)
        if reason := unclear(renderer, episode, driven.trajectory.xyyaw, config.episode):
            return StageResult(rejected=reason)
        offered = claim.policy.sha256 if claim.policy and policy else ""
        header = dataclasses.replace(
            episode_header(renderer, scenario, driven.trajectory, driver),
            policy=offered,
            image_every=every,
        )
        pictures = (camera.pictures.get(step, NO_PICTURE) for step in range(header.sample_count))
        seen = described_samples(renderer, scenario, motions, driven.trajectory, pictures)
        samples = (
            dataclasses.replace(sample, expert_commands=commands, risks=risks)
            for sample, commands, risks in zip(seen, driven.expert_commands, driven.risks, strict=True)
        )
        append_episode(bus, claim, header, _with_goal(world, renderer, scenario, samples))
        return None

    return work


def _labels(world: World) -> Callable[[EpisodeSimulation], LabellingExpert]:
    """Makes who labels an episode: the run's teacher, or the expert."""
    planner, ref = world.robot_planner, world.spec.teacher
    if ref is not None and ref.kind is TeacherKind.EXPERT_TRACKED:
        return lambda simulation: planner.detecting_expert(simulation.scenario, PERCEIVED)
    if world.teacher is None:
        return lambda simulation: planner.expert(simulation.scenario, simulation.motions)
    driver = state_driver(world, world.teacher)
    return lambda simulation: StateTeacher(driver, simulation)


def _with_goal(world: World, renderer: Renderer, scenario: Scenario, samples: Iterator[Sample]) -> Iterator[Sample]:
    """The samples, with an image of the goal if the run records it."""
    if not world.config.renderer.goal_image:
        return samples
    radius_m = robot_of_episode(world.config.robot, scenario.episode).planning_radius_m
    pose = goal_pose(scenario, world.scene.maps.robot, radius_m)
    return with_goal_image(samples, goal_picture(renderer, scenario.episode, pose))


def _evaluate(world: World, bus: Bus) -> Work:
    # Imported here: workers of other stages do not need the evaluator.
    from readygo.runs.evaluating import evaluation_work

    return evaluation_work(world, bus)


def _scenario(inputs: Inputs) -> Scenario:
    scenario = decode(HumanPlanReply, inputs[HUMAN_PLAN.name]).scenario
    assert scenario is not None
    return scenario


def _motions(inputs: Inputs) -> EpisodeMotions:
    motions = decode(AnimateReply, inputs[ANIMATE.name]).motions
    assert motions is not None
    return motions


LINE: Sequence[Entry] = (
    Entry(stage=HUMAN_PLAN, work=_plan_humans),
    Entry(stage=ANIMATE, work=_animate),
    Entry(stage=ROBOT_PLAN, work=_plan_robot),
    Entry(stage=RENDER, work=_render),
    Entry(stage=DRIVE, work=_drive),
    Entry(stage=EVALUATE, work=_evaluate),
)
"""All known stages, of every kind of run."""
