"""`readygo plan`: replays one episode of the expert or of a policy, and explains it."""

import dataclasses
import inspect
import json as json_module
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.table import Table

from readygo.apps.cli import option_name
from readygo.apps.evaluation.again import kept_episode
from readygo.apps.run.config import RunConfig, check_cameras
from readygo.apps.run.evaluation import evaluation_config
from readygo.apps.run.origin import avatars_of_policy
from readygo.apps.run.scene_argument import open_maps
from readygo.apps.run.take import Take, Takes, policy_driver
from readygo.apps.terminal import PlainConsole
from readygo.common.avatars import Avatar
from readygo.common.avatars.cast import load_cast
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.drawing.files import Picture, write_png
from readygo.common.drawing.film import CODECS
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, Split
from readygo.common.policy import load_policy
from readygo.common.robot import load_robot
from readygo.common.scenes import Scene
from readygo.services.planner import ExpertConfig, RobotPlanner
from readygo.services.planner.explain.numbers import Numbers, run_numbers, scenario_numbers
from readygo.services.planner.explain.picture import Look, draw_episode, draw_run
from readygo.services.planner.humans.mixes import MixName
from readygo.services.planner.humans.scenario_file import load_scenarios, save_scenarios
from readygo.services.renderer import Renderer, SensorName

if TYPE_CHECKING:
    from readygo.apps.pictures.plan_film import RobotView

_WITH_RESULTS = ("scene", "from_", "task", "method", "picture", "video", "camera", "export", "json")
"""Arguments that go with an episode of an evaluation."""


def plan(
    scene: str,
    /,
    *,
    from_: Path | None = None,
    task: Literal["static", "dynamic", "reactive"] | None = None,
    method: str = "",
    index: int = 0,
    seed: int = 0,
    split: Literal["train", "val", "test"] = "train",
    mode: str = "",
    static: bool = False,
    people: MixName | None = None,
    scenarios: Path | None = None,
    policy: Path | None = None,
    config: Path | None = None,
    robot: Path | None = None,
    sensor: SensorName | None = None,
    avatars: Path | None = None,
    picture: Path | None = None,
    video: Path | None = None,
    camera: bool = False,
    export: Path | None = None,
    json: bool = False,
) -> None:
    """Replay one episode, and show what the expert or a policy did, and why.

    With the seed, split, index and settings of `readygo generate` it is the same episode. Episodes that generate
    rejects because the expert fails are shown as well; an index without a scenario is an error. With a policy, the
    episodes are those of `readygo evaluate`, whose split is test, and the expert's labels are shown too.

    `readygo plan --from RESULTS test-0-000003` replays an episode of an evaluation by its executed commands, with any
    driver; all settings are those of the evaluation.

    Args:
        scene: Scene bundle, "embedded", or a ROS map (.yaml) with a flat floor; with `from`, the name of an episode.
        from_: Folder of an evaluation (`readygo evaluate --out`).
        task: Task of the evaluation, with `from`.
        method: Driver, with `from`; the policy by default, else the expert.
        index: Index of the episode.
        seed: Seed of the run.
        split: Split that the episode is drawn from.
        mode: Planning mode of the expert, "paper" or "spacetime"; as in `config` by default.
        static: Leave the pedestrians out.
        people: Scenario mix: how many pedestrians there are and how they meet the robot, as for `readygo generate`.
        scenarios: TOML file with scenarios to play instead of drawn ones: entry `index` modulo their number.
        policy: Folder of a trained policy that drives instead of the expert; robot, camera, avatars and settings are
            those of its data unless other options name them.
        config: TOML file with sections of settings, as for `readygo generate`.
        robot: robot.toml of a different robot.
        sensor: Recipe of the camera's lens, light and shutter and of their variation.
        avatars: Avatar file or folder of avatars; by default those of the policy's data, else the embedded ones.
        picture: PNG to write: the map, the paths, rejected plans, what the robot saw and expected, the outcome.
        video: .webm (quick to write) or .mp4: the same over time, in real time.
        camera: Show the robot's camera images in picture and video, as `generate` records them; always shown with a
            policy.
        export: TOML file for the scenario, to edit or share.
        json: Print the numbers as JSON.
    """
    given = dict(locals())
    _check_endings(picture, video, export)
    if from_ is not None:
        _refuse_settings(given)
        with kept_episode(from_, scene, task or "", method) as (replays, record):
            run = replays.run(record)
            take = Take(scenario=run.scenario, run=run, rejected="", drive_ms=0.0)
            view = replays.view(run) if picture or video else None
            numbers = {"episode": record.episode.episode_id, "driver": run.driver, **run_numbers(run)}
            planner = replays.world.robot_planner.of(record.episode)
            _show(take, numbers, planner, view, picture, video, export, json=json)
        return
    if task or method:
        raise RunError("--task and --method choose an episode of an evaluation: give its folder with --from.")
    camera = camera or policy is not None
    _check(scene, index, seed, camera=camera)
    if camera and policy is None and picture is None and video is None:
        raise RunError("--camera shows the robot's view: say where with --picture FILE.png or --video FILE.webm.")
    driving = load_policy(policy) if policy else None
    run_config = evaluation_config(
        driving.spec if driving else None,
        "policy",
        config=config,
        robot=load_robot(robot, cameras_of=driving.spec.robot if driving else None) if robot else None,
        sensor=sensor,
        humans=people,
    )
    if mode:
        run_config = dataclasses.replace(run_config, expert=_with_mode(run_config.expert, mode))
    if driving and not (avatars or static):
        avatars = avatars_of_policy(driving.spec)
    maps, bundle = open_maps(scene)
    humans = {} if static else load_cast(avatars)
    takes = Takes(maps, humans, run_config, load_scenarios(scenarios) if scenarios else None)
    renderer = _renderer(bundle, humans, run_config) if camera and bundle else None
    policy_drives = policy_driver(driving, renderer) if driving and renderer else None
    take = takes.take(EpisodeKey(seed=seed, split=Split(split), index=index), static=static, policy=policy_drives)
    sees = driving.spec.images if driving else ()
    planner = takes.robot_planner.of(take.scenario.episode)
    numbers = _numbers(take, run_config.expert.mode)
    _show(take, numbers, planner, _look(take, renderer, sees), picture, video, export, json=json)


def _refuse_settings(given: Mapping[str, Any]) -> None:
    """Raise RunError if an option changes what an evaluation has fixed.

    Args:
        given: Arguments of `plan`, by name.
    """
    parameters = inspect.signature(plan).parameters.values()
    changed = [option_name(p.name) for p in parameters if p.name not in _WITH_RESULTS and given[p.name] != p.default]
    if changed:
        raise RunError(f"--from takes all settings from the evaluation: leave out {', '.join(changed)}.")


def _show(
    take: Take,
    numbers: Numbers,
    planner: RobotPlanner,
    look: "RobotView | None",
    picture: Path | None,
    video: Path | None,
    export: Path | None,
    *,
    json: bool,
) -> None:
    """Write the requested files, and print the numbers."""
    if picture is not None:
        write_png(picture, _picture(take, planner, look))
    if video is not None:
        _write_video(video, take, planner, look)
    if export is not None:
        save_scenarios(export, [take.scenario])
    if json:
        sys.stdout.write(json_module.dumps(numbers, indent=2) + "\n")
    else:
        _print(numbers, [path for path in (picture, video, export) if path is not None])


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


def _with_mode(expert: ExpertConfig, mode: str) -> ExpertConfig:
    return section_from_mapping(ExpertConfig, {**section_to_mapping(expert), "mode": mode}, where="--")


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


def _picture(take: Take, planner: RobotPlanner, look: Look | None) -> Picture:
    if take.run is not None:
        return draw_run(planner, take.run, look)
    return draw_episode(planner.maps.robot, take.scenario, robot=planner.robot, episode_config=planner.episode_config)


def _write_video(path: Path, take: Take, planner: RobotPlanner, look: "RobotView | None") -> None:
    """Write a video of the run.

    Raises:
        RunError: If the episode has no run.
    """
    from readygo.apps.pictures.plan_film import run_film
    from readygo.common.drawing.film import write_film

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
        rows.append(("way", f"{numbers['path_length_m']:.2f} m"))
        rows += [("replans", _replans(numbers))] if "replans" in numbers else []
        rows += [("a person in view", f"{share:.0f} % of the time")] if numbers["humans"] else []
    rows += [(f"person {k}", _human_row(human)) for k, human in enumerate(numbers["humans"], start=1)]
    if "rejected" in numbers:
        left_out = f"no: {numbers['rejected'].replace('_', ' ')}" if numbers["rejected"] else "yes"
        rows.append(("recorded by generate", left_out))
    return rows


def _replans(numbers: Numbers) -> str:
    text = f"{numbers['replans']}, {numbers['ways']} different ways"
    if not numbers["replans"]:
        return text
    return f"{text}; p50 {numbers['replan_p50_ms']:.2f} ms, p99 {numbers['replan_p99_ms']:.2f} ms"


def _human_row(human: Numbers) -> str:
    text = f"{human['avatar']}, {human['encounter']}, {human['speed_mps']:.2f} m/s"
    if "closest_m" not in human:
        return text
    seen = ", ".join(f"{begin:.2f}-{end:.2f} s" for begin, end in human["visible_s"]) or "never"
    return f"{text}; closest {human['closest_m']:.2f} m at {human['closest_s']:.2f} s; in view {seen}"
