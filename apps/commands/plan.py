"""`readygo plan`: replays one episode of the expert or of a policy, and explains it."""

import dataclasses
import json as json_module
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.table import Table
from tyro.conf import Positional

from readygo.apps.evaluation.again import kept_episode
from readygo.apps.options import given_options
from readygo.apps.pictures.film import CODECS
from readygo.apps.terminal import PlainConsole
from readygo.common.arrays import UInt8Array
from readygo.common.avatars import Avatar
from readygo.common.avatars.cast import load_cast
from readygo.common.drawing.files import write_png
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, Split
from readygo.common.policy import Policy, load_policy
from readygo.common.robot import load_robot
from readygo.common.scenes import Scene
from readygo.runs.config import RunConfig, SimulationKeys, check_cameras
from readygo.runs.evaluation import evaluation_config
from readygo.runs.methods import CHECKPOINTS
from readygo.runs.options import WorldOptions
from readygo.runs.origin import avatars_of_policy
from readygo.runs.scene_argument import open_maps
from readygo.runs.take import Take, Takes, policy_driver
from readygo.services.planner import (
    Look,
    MixName,
    Numbers,
    RobotPlanner,
    draw_episode,
    draw_run,
    load_scenarios,
    run_numbers,
    save_scenarios,
    scenario_numbers,
)
from readygo.services.renderer import Renderer

if TYPE_CHECKING:
    from readygo.apps.pictures.plan_film import RobotView

_WITH_RESULTS = ("scene", "from_", "task", "method", "checkpoints", "picture", "video", "camera", "export", "json")
"""Fields that go with an episode of an evaluation."""


@dataclass(frozen=True, kw_only=True)
class PlanEpisodeOptions:
    """Which episode, and what is shown of it."""

    task: Literal["static", "dynamic", "reactive"] | None = None
    """Task of the evaluation, with `from`."""
    method: str = ""
    """Driver, with `from`; the policy by default, else the expert."""
    checkpoints: Path = CHECKPOINTS
    """Folder with the network `perception`, whose answers are shown of episodes that perceive-and-plan or
    perceive-and-act drove."""
    split: Literal["train", "val", "test"] = "train"
    """Split that the episode is drawn from."""
    static: bool = False
    """Leave the pedestrians out."""
    camera: bool = False
    """Show the robot's camera images in picture and video, as `generate` records them; always shown with a policy."""


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """Replay one episode, and show what the expert or a policy did, and why.

    With the seed, split, index and settings of `readygo generate` it is the same episode. Episodes that generate
    rejects because the expert fails are shown as well; an index without a scenario is an error. With a policy, the
    episodes are those of `readygo evaluate`, whose split is test, and the expert's labels are shown too.

    `readygo plan --from RESULTS test-0-000003` replays an episode of an evaluation by its executed commands, with any
    driver; all settings are those of the evaluation.
    """

    scene: Positional[str]
    """Scene bundle, "embedded", or a ROS map (.yaml) with a flat floor; with `from`, the name of an episode."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """Folder of an evaluation (`readygo evaluate --out`)."""
    index: int = 0
    """Index of the episode."""
    seed: int = 0
    """Seed of the run."""
    people: MixName | None = None
    """Scenario mix: how many pedestrians there are and how they meet the robot, as for `readygo generate`."""
    policy: Path | None = None
    """Folder of a trained policy that drives instead of the expert; robot, camera, avatars and settings are those
    of its data unless other options name them."""
    config: Path | None = None
    """TOML file with sections of settings, as for `readygo generate`."""
    robot: Path | None = None
    """robot.toml of a different robot."""
    picture: Path | None = None
    """PNG to write: the map, the paths, rejected plans, what the robot saw and expected, the outcome."""
    video: Path | None = None
    """.webm (quick to write) or .mp4: the same over time, in real time."""
    export: Path | None = None
    """TOML file for the scenario, to edit or share."""
    json: bool = False
    """Print the numbers as JSON."""
    episode: PlanEpisodeOptions = field(default_factory=PlanEpisodeOptions)
    world: WorldOptions = field(default_factory=WorldOptions)
    keys: SimulationKeys = field(default_factory=dict)


def plan(options: PlanOptions) -> None:
    """Replay one episode, and show what the expert or a policy did, and why."""
    _check_endings(options.picture, options.video, options.export)
    if options.from_ is not None:
        _replay_kept(options, options.from_)
        return
    episode = options.episode
    if episode.task or episode.method:
        raise RunError("--task and --method choose an episode of an evaluation: give its folder with --from.")
    camera = episode.camera or options.policy is not None
    _check(options.scene, options.index, options.seed, camera=camera)
    if camera and options.policy is None and options.picture is None and options.video is None:
        raise RunError("--camera shows the robot's view: say where with --picture FILE.png or --video FILE.webm.")
    policy = load_policy(options.policy) if options.policy else None
    config = _config(options, policy)
    avatars, scenarios = options.world.avatars, options.world.scenarios
    if policy and not (avatars or episode.static):
        avatars = avatars_of_policy(policy.spec)
    maps, bundle = open_maps(options.scene)
    humans = {} if episode.static else load_cast(avatars)
    takes = Takes(maps, humans, config, load_scenarios(scenarios) if scenarios else None)
    renderer = _renderer(bundle, humans, config) if camera and bundle else None
    take = takes.take(
        EpisodeKey(seed=options.seed, split=Split(episode.split), index=options.index),
        static=episode.static,
        policy=policy_driver(policy, renderer) if policy and renderer else None,
    )
    planner = takes.robot_planner.of(take.scenario.episode)
    look = _look(take, renderer, policy.spec.images if policy else ())
    _show(take, _numbers(take, config.expert.mode), planner, look, options)


def _replay_kept(options: PlanOptions, results: Path) -> None:
    """Show an episode of an evaluation."""
    _refuse_settings(options)
    episode = options.episode
    with kept_episode(results, options.scene, episode.task or "", episode.method, checkpoints=episode.checkpoints) as (
        replays,
        record,
    ):
        run = replays.run(record)
        take = Take(scenario=run.scenario, run=run, rejected="", drive_ms=0.0)
        view = replays.view(run) if options.picture or options.video else None
        numbers = {"episode": record.episode.episode_id, "driver": run.driver, **run_numbers(run)}
        _show(take, numbers, replays.world.robot_planner.of(record.episode), view, options)


def _refuse_settings(options: PlanOptions) -> None:
    """Raise RunError if an option changes what an evaluation has fixed."""
    if given := given_options(options, _WITH_RESULTS):
        raise RunError(f"--from takes all settings from the evaluation: leave out {', '.join(given)}.")


def _config(options: PlanOptions, policy: Policy | None) -> RunConfig:
    cameras_of = policy.spec.robot if policy else None
    return evaluation_config(
        policy.spec if policy else None,
        "policy",
        config=options.config,
        robot=load_robot(options.robot, cameras_of=cameras_of) if options.robot else None,
        sensor=options.world.sensor,
        humans=options.people,
        keys=options.keys,
    )


def _show(take: Take, numbers: Numbers, planner: RobotPlanner, look: "RobotView | None", options: PlanOptions) -> None:
    """Write the requested files, and print the numbers."""
    if options.picture is not None:
        write_png(options.picture, _picture(take, planner, look))
    if options.video is not None:
        _write_video(options.video, take, planner, look)
    if options.export is not None:
        save_scenarios(options.export, [take.scenario])
    if options.json:
        sys.stdout.write(json_module.dumps(numbers, indent=2) + "\n")
    else:
        files = (options.picture, options.video, options.export)
        _print(numbers, [path for path in files if path is not None])


def _check(scene: str, index: int, seed: int, *, camera: bool) -> None:
    """Raise RunError if index or seed is out of range, or a camera is asked for in a ROS map."""
    if index < 0 or not 0 <= seed < 2**63:
        raise RunError(f"--index must be at least 0 and --seed 0..2^63-1, got {index} and {seed}.")
    if camera and scene.endswith((".yaml", ".yml")):
        raise RunError(f"--camera and --policy need a scene bundle to see: {scene} is a map.")


def _check_endings(picture: Path | None, video: Path | None, export: Path | None) -> None:
    """Raise RunError if a file's name has the wrong extension."""
    files = (("--picture", picture, (".png",)), ("--video", video, tuple(CODECS)), ("--export", export, (".toml",)))
    for option, path, endings in files:
        if path is not None and path.suffix.lower() not in endings:
            raise RunError(f"{option} {path} must end in {' or '.join(endings)}.")


def _renderer(scene: Scene, avatars: dict[str, Avatar], config: RunConfig) -> Renderer:
    """The renderer of the robot's camera images.

    Raises:
        ConfigError: If the robot's camera cannot have the sensor's lens.
    """
    check_cameras(config)
    only_rgb = dataclasses.replace(config.renderer, outputs=("rgb",))
    return Renderer(scene=scene, avatars=avatars, robot=config.robot, config=only_rgb)


def _look(take: Take, renderer: Renderer | None, sees: Sequence[str]) -> "RobotView | None":
    """The view of the robot's cameras; None without a renderer or a run."""
    from readygo.apps.pictures.plan_film import RobotView

    run = take.run
    if renderer is None or run is None:
        return None
    return RobotView(renderer, run.scenario, run.motions, run.trajectory, sees=sees)


def _picture(take: Take, planner: RobotPlanner, look: Look | None) -> UInt8Array:
    if take.run is not None:
        return draw_run(planner, take.run, look)
    return draw_episode(planner.maps.robot, take.scenario, robot=planner.robot, episode_config=planner.episode_config)


def _write_video(path: Path, take: Take, planner: RobotPlanner, look: "RobotView | None") -> None:
    """Write a video of the run.

    Raises:
        RunError: If the episode has no run.
    """
    from readygo.apps.pictures.film import write_film
    from readygo.apps.pictures.plan_film import run_film

    if take.run is None:
        raise RunError(f"There is nothing to film in {take.scenario.episode.episode_id}: {take.rejected}.")
    write_film(path, run_film(planner, take.run, look))


def _numbers(take: Take, mode: str) -> Numbers:
    head = {"episode": take.scenario.episode.episode_id, "mode": mode, "rejected": take.rejected}
    if take.run is None:
        return {**head, **scenario_numbers(take.scenario)}
    if not take.run.explained:
        return {"episode": head["episode"], "driver": take.run.driver, **run_numbers(take.run)}
    return {**head, **run_numbers(take.run), "drive_ms": round(take.drive_ms, 2)}


def _print(numbers: Numbers, written: Sequence[Path]) -> None:
    who = f"mode {numbers['mode']}" if "mode" in numbers else f"{numbers['driver']} drives"
    table = Table(title=f"episode {numbers['episode']}, {who}", show_header=False)
    for name, value in _rows(numbers):
        table.add_row(name, value)
    console = PlainConsole()
    console.print(table)
    for path in written:
        console.print(f"Open {path}.", markup=False, soft_wrap=True)


def _rows(numbers: Numbers) -> list[tuple[str, str]]:
    rows = [("goal", f"{numbers['goal_distance_m']:.2f} m away")]
    if "outcome" in numbers:
        share = 100 * numbers["human_visible_share"]
        rows.insert(0, ("outcome", f"{numbers['outcome'].replace('_', ' ')} after {numbers['duration_s']:.2f} s"))
        rows.append(("path", f"{numbers['path_length_m']:.2f} m"))
        rows += [("replans", _replans(numbers))] if "replans" in numbers else []
        rows += [("a pedestrian in view", f"{share:.0f} % of the time")] if numbers["humans"] else []
    rows += [(f"pedestrian {k}", _human_row(human)) for k, human in enumerate(numbers["humans"], start=1)]
    if "rejected" in numbers:
        left_out = f"no: {numbers['rejected'].replace('_', ' ')}" if numbers["rejected"] else "yes"
        rows.append(("recorded by generate", left_out))
    return rows


def _replans(numbers: Numbers) -> str:
    text = f"{numbers['replans']}, {numbers['paths']} different paths"
    if not numbers["replans"]:
        return text
    return f"{text}; p50 {numbers['replan_p50_ms']:.2f} ms, p99 {numbers['replan_p99_ms']:.2f} ms"


def _human_row(human: Numbers) -> str:
    text = f"{human['avatar']}, {human['encounter']}, {human['speed_mps']:.2f} m/s"
    if "closest_m" not in human:
        return text
    seen = ", ".join(f"{begin:.2f}-{end:.2f} s" for begin, end in human["visible_s"]) or "never"
    return f"{text}; closest {human['closest_m']:.2f} m at {human['closest_s']:.2f} s; in view {seen}"
