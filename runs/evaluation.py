"""Makes an evaluator in this process from settings, and summaries from its reply."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from readygo.common.bus import InProcessBus
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.config import section_to_mapping
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import RunError
from readygo.common.messages import Split
from readygo.common.policy import Policy, PolicySpec, check_policy_camera, check_policy_limits, load_policy
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.identity import identity
from readygo.runs.live_humans import live_simulations
from readygo.runs.methods import named_methods
from readygo.runs.origin import DataOrigin, avatars_of_policy, settings_of_policy, with_origin
from readygo.runs.scene_argument import open_scene
from readygo.runs.sections import NO_KEYS, Keys
from readygo.runs.spec import make_spec
from readygo.runs.world import World
from readygo.services.animator import attach as attach_animator
from readygo.services.evaluator import (
    EXPERT,
    METHODS,
    RENDERER,
    EvaluateReply,
    EvaluateRequest,
    Evaluator,
    EvaluatorConfig,
    MakeDriver,
    Task,
    compare_all,
    comparison_mapping,
    failure_counts,
    handle_evaluate,
    score_mapping,
    scores_of,
    summary_mapping,
)
from readygo.services.planner import MixName
from readygo.services.planner import attach as attach_planner
from readygo.services.renderer import Renderer, SensorName
from readygo.services.renderer import attach as attach_renderer

CameraName = Literal["policy", "robot"]


def evaluation_config(
    policy: PolicySpec | None,
    camera: CameraName,
    *,
    config: Path | None,
    robot: RobotConfig | None,
    sensor: SensorName | None,
    humans: MixName | None,
    keys: Keys = NO_KEYS,
) -> RunConfig:
    """The settings of an evaluation; by default those of the policy's data, including the robot.

    Args:
        policy: Spec of the policy; None without one.
        camera: "policy" takes the policy's camera, "robot" that of the other settings.
        config: TOML file with sections of settings.
        robot: Robot to use.
        sensor: Recipe of the camera.
        humans: Scenario mix.
        keys: Keys of the command line, by section.

    Raises:
        ConfigError: If the file cannot be read.
        PolicyError: If the settings ask for a robot of other limits than the policy's, or for another camera where
            `camera` asks for the policy's.
    """
    base = settings_of_policy(spec_with_camera(policy, camera), humans=humans is None) if policy else None
    settings = load_run_config(config, robot, sensor, humans, base=base, keys=keys)
    if policy is not None:
        check_policy_limits(policy, settings.robot)
    if policy is not None and camera == "policy":
        check_policy_camera(policy, settings.robot, settings.renderer.sensor)
    return settings


def spec_with_camera(spec: PolicySpec, camera: CameraName) -> PolicySpec:
    """The policy's spec as the default robot; without its camera if `camera` is "robot"."""
    if camera == "policy":
        return spec
    robot = dataclasses.replace(spec.robot, camera=CameraConfig())
    return dataclasses.replace(spec, robot=robot, sensor=SensorConfig())


def make_request(
    episodes: int,
    tasks: tuple[str, ...],
    methods: tuple[str, ...],
    split: Split,
    seed: int,
    *,
    control_hz: float | None = None,
) -> EvaluateRequest:
    """Make a request from command-line arguments.

    Raises:
        RunError: If an argument is invalid.
    """
    try:
        return EvaluateRequest(
            tasks=tuple(Task(task) for task in tasks),
            methods=methods,
            episodes=episodes,
            seed=seed,
            split=split,
            control_hz=control_hz,
        )
    except ValueError as error:
        raise RunError(f"These arguments make no evaluation: {error}") from error


def make_evaluator_config(lockstep: int) -> EvaluatorConfig:
    """The evaluator's settings.

    Raises:
        RunError: If `lockstep` is out of range.
    """
    try:
        return EvaluatorConfig(lockstep=lockstep)
    except ValueError as error:
        raise RunError(str(error)) from error


def evaluation_world(
    scene: str,
    config: RunConfig,
    *,
    avatars: Path | None,
    seed: int,
    split: Split = Split.TEST,
    scenarios: Path | None = None,
) -> World:
    """The world of an evaluation: scene, avatars and scenarios.

    Args:
        scene: Scene bundle, "embedded", or "embedded:SEED".
        config: All settings.
        avatars: Avatar file or folder of avatars; None stands for the embedded ones.
        seed: Seed of the episodes.
        split: Split that the episodes are drawn from.
        scenarios: TOML file with scenarios to play instead of drawn ones.

    Raises:
        ReadygoError: If scene, avatars or scenarios cannot be used.
    """
    return World(
        make_spec(open_scene(scene), avatars, config, seed=seed, split=split, static=False, scenarios=scenarios)
    )


def make_evaluator(
    world: World,
    *,
    renderer: Renderer | None = None,
    policy: Policy | None = None,
    evaluator_config: EvaluatorConfig | None = None,
    camera: CameraName = "policy",
    methods: Mapping[str, MakeDriver] | None = None,
) -> Evaluator:
    """An evaluator with planner and animator, all in this process.

    Args:
        world: World, from `evaluation_world`.
        renderer: Renderer of the camera images; None if no policy drives.
        policy: Policy that drives; it can be replaced in the evaluator later.
        evaluator_config: Settings of the evaluator.
        camera: "policy" looks through the policy's camera, "robot" through that of the settings.
        methods: Makers of drivers by name, from `named_methods`; all named methods by default.

    Raises:
        PolicyError: If the policy was trained with a different camera.
    """
    bus, config = InProcessBus(), world.config
    humans = world.human_planner(react=False)
    attach_planner(bus, humans, world.robot_planner)
    attach_animator(bus, world.animator())
    if renderer is not None:
        attach_renderer(bus, renderer, RENDERER)
    return Evaluator(
        bus=bus,
        robot=config.robot,
        robot_map=world.scene.maps.robot,
        floor=world.scene.maps.floor,
        episode_config=config.episode,
        config=evaluator_config or EvaluatorConfig(),
        policy=policy,
        camera=camera,
        drivers=named_methods(world) if methods is None else methods,
        simulate=live_simulations(world, humans),
        find_sight=lambda: world.scene.maps.sight,
    )


def evaluation_settings(
    world: World,
    request: EvaluateRequest,
    *,
    policy: str,
    camera: CameraName,
    methods: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Settings that records depend on besides task, method and index, as plain values for `open_results`.

    Args:
        world: World of the evaluation.
        request: Request of the evaluation.
        policy: SHA-256 of the policy, empty without one.
        camera: Camera of the policy: "policy" or "robot".
        methods: SHA-256 of the methods that are files, from `method_hashes`.
    """
    return {
        **identity(world.spec),
        "seed": request.seed,
        "split": request.split.value,
        "control_hz": request.control_hz or world.config.robot.control_hz,
        "policy": policy,
        "camera": camera,
        METHODS: dict(methods or {}),
    }


def summarize(reply: EvaluateReply, request: EvaluateRequest, evaluator: Evaluator) -> dict[str, Any]:
    """The content of `summary.json`: scores, and the conditions of the evaluation."""
    policy = evaluator.policy
    return {
        "scores": summary_mapping(reply.summaries),
        **tables(reply, request, evaluator.episode_config),
        "episodes": request.episodes,
        "seed": request.seed,
        "split": request.split.value,
        "control_hz": request.control_hz or evaluator.robot.control_hz,
        "skipped": reply.skipped,
        "robot": section_to_mapping(evaluator.robot),
        "episode": section_to_mapping(evaluator.episode_config),
        "sees": list(policy.spec.images) if policy is not None else [],
        "policy_training": dict(policy.spec.training) if policy is not None else None,
    }


def tables(reply: EvaluateReply, request: EvaluateRequest, config: EpisodeConfig) -> dict[str, Any]:
    """All measures with intervals, comparisons of methods, and failure counts, as plain values."""
    records, limit_s = reply.records, config.time_limit_s
    failures: dict[str, dict[str, dict[str, int]]] = {}
    for (task, method), counts in failure_counts(records).items():
        failures.setdefault(task.value, {})[method] = {kind.name.lower(): count for kind, count in counts.items()}
    return {
        "measures": score_mapping(scores_of(records, time_limit_s=limit_s)),
        "comparisons": [
            comparison_mapping(comparison)
            for reference in references(request.methods)
            for comparison in compare_all(records, reference, time_limit_s=limit_s)
        ],
        "failures": failures,
    }


def references(methods: Sequence[str]) -> list[str]:
    """Reference methods of comparisons: the first method, and the expert if it drives."""
    return list(dict.fromkeys([methods[0], *([EXPERT] if EXPERT in methods else [])])) if methods else []


def closed_loop(scene: str, *, episodes: int, seed: int, origin: DataOrigin | None = None) -> Callable[[Path], float]:
    """A function that measures the mean of a policy's static and dynamic success rates on the split val of a scene.

    Args:
        scene: Scene bundle, "embedded", or "embedded:SEED".
        episodes: Episodes of a measurement, per task.
        seed: Seed of the episodes.
        origin: Origin of the policy's data, with avatars and rendering settings; the defaults if None.

    Raises:
        RunError: If an argument is invalid.
        SceneError: If there is no such scene.
    """
    # Report errors in these now, not at the first checkpoint.
    request = make_request(episodes, ("static", "dynamic"), ("policy",), Split.VAL, seed)
    open_scene(scene)
    evaluators: dict[str, Evaluator] = {}

    def success_rate(folder: Path) -> float:
        policy = load_policy(folder)
        if scene not in evaluators:
            spec = with_origin(policy.spec, origin or DataOrigin())
            avatars = avatars_of_policy(spec)
            world = evaluation_world(scene, settings_of_policy(spec), avatars=avatars, seed=seed, split=request.split)
            evaluators[scene] = make_evaluator(world, renderer=world.renderer())
        evaluator = dataclasses.replace(evaluators[scene], policy=policy)
        rates = [summary.success_rate for summary in handle_evaluate(evaluator, request).summaries.values()]
        return sum(rates) / len(rates)

    return success_rate
