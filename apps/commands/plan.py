"""`readygo plan`: one episode of the expert, planned again and explained."""

import dataclasses
import json as json_module
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.table import Table

from readygo.apps.run.config import RunConfig, load_run_config
from readygo.apps.run.scene_argument import open_maps
from readygo.apps.run.take import Take, Takes
from readygo.common.avatars import Avatar, load_avatars
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.drawing.files import Picture, write_png
from readygo.common.drawing.film import CODECS
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, Split
from readygo.common.robot import load_robot
from readygo.common.scenes import Scene
from readygo.services.planner import ExpertConfig, RobotPlanner
from readygo.services.planner.explain.numbers import Numbers, run_numbers, scenario_numbers
from readygo.services.planner.explain.picture import draw_episode, draw_run
from readygo.services.planner.humans.scenario_file import save_scenarios


def plan(
    scene: str,
    /,
    *,
    index: int = 0,
    seed: int = 0,
    split: Literal["train", "val", "test"] = "train",
    mode: str = "",
    static: bool = False,
    config: Path | None = None,
    robot: Path | None = None,
    avatars: Path | None = None,
    picture: Path | None = None,
    video: Path | None = None,
    camera: bool = False,
    export: Path | None = None,
    json: bool = False,
) -> None:
    """Plan one episode again, and say and show what the expert did and why.

    Seed, split, index and settings are those of `readygo generate`: the same episode. One that generate leaves out,
    because the expert fails, is shown as well; an index without a scenario is an error.

    Args:
        scene: Scene bundle, "embedded", or a ROS map (.yaml) with a flat floor.
        index: Number of the episode.
        seed: Seed of the run.
        split: Random streams to draw the episode from.
        mode: How the expert plans, "paper" or "spacetime"; as in `config` by default.
        static: Leave the humans out.
        config: TOML file with sections of settings, as given to `readygo generate`.
        robot: robot.toml of another robot.
        avatars: Avatar file or folder of them; the embedded ones by default.
        picture: PNG to write: the map, the ways, plans given up, what the robot saw and expected, the outcome.
        video: .webm (quick to write) or .mp4: the same over time, in real time.
        camera: Show the robot's camera in the video, drawn as `generate` records it.
        export: TOML file to write with the scenario, to be changed by hand or given to others.
        json: Print the numbers as JSON.
    """
    _check(scene, index, seed, camera=camera, video=video)
    _check_endings(picture, video, export)
    run_config = load_run_config(config, load_robot(robot) if robot else None)
    if mode:
        run_config = dataclasses.replace(run_config, expert=_with_mode(run_config.expert, mode))
    episode = EpisodeKey(seed=seed, split=Split(split), index=index)
    maps, bundle = open_maps(scene)
    people = {} if static else load_avatars(avatars)
    takes = Takes(maps, people, run_config)
    take = takes.take(episode, static=static)
    if picture is not None:
        write_png(picture, _picture(take, takes.robot_planner))
    if video is not None:
        images = _camera(take, bundle, people, run_config) if camera else None
        _write_video(video, take, takes.robot_planner, images)
    if export is not None:
        save_scenarios(export, [take.scenario])
    numbers = _numbers(take, run_config.expert.mode)
    if json:
        sys.stdout.write(json_module.dumps(numbers, indent=2) + "\n")
    else:
        _print(numbers, [path for path in (picture, video, export) if path is not None])


def _check(scene: str, index: int, seed: int, *, camera: bool, video: Path | None) -> None:
    """Raise RunError if the arguments make no sense."""
    if index < 0 or not 0 <= seed < 2**63:
        raise RunError(f"--index must be at least 0 and --seed 0..2^63-1, got {index} and {seed}.")
    if camera and video is None:
        raise RunError("--camera shows the robot's view in a video: say where with --video FILE.webm.")
    if camera and scene.endswith((".yaml", ".yml")):
        raise RunError(f"--camera needs a scene bundle to draw: {scene} is a map.")


def _check_endings(picture: Path | None, video: Path | None, export: Path | None) -> None:
    """Raise RunError if a file's name does not say what it will be."""
    files = (("--picture", picture, (".png",)), ("--video", video, tuple(CODECS)), ("--export", export, (".toml",)))
    for option, path, endings in files:
        if path is not None and path.suffix.lower() not in endings:
            raise RunError(f"{option} {path} must end in {' or '.join(endings)}.")


def _with_mode(expert: ExpertConfig, mode: str) -> ExpertConfig:
    return section_from_mapping(ExpertConfig, {**section_to_mapping(expert), "mode": mode}, where="--")


def _picture(take: Take, planner: RobotPlanner) -> Picture:
    if take.run is not None:
        return draw_run(planner, take.run)
    return draw_episode(planner.maps.robot, take.scenario, robot=planner.robot, episode_config=planner.episode_config)


def _write_video(path: Path, take: Take, planner: RobotPlanner, camera: Iterator[Picture] | None) -> None:
    """Film the run.

    Raises:
        RunError: If there is no run.
    """
    from readygo.apps.pictures.plan_film import run_film
    from readygo.common.drawing.film import write_film

    if take.run is None:
        raise RunError(f"There is nothing to film in {take.scenario.episode.episode_id}: {take.rejected}.")
    write_film(path, run_film(planner, take.run, camera))


def _camera(take: Take, scene: Scene | None, avatars: dict[str, Avatar], config: RunConfig) -> Iterator[Picture] | None:
    """What the robot's camera sees; None without a scene or a run."""
    from readygo.apps.pictures.plan_film import camera_images

    return camera_images(scene, avatars, config, take.run) if scene is not None and take.run is not None else None


def _numbers(take: Take, mode: str) -> Numbers:
    head = {"episode": take.scenario.episode.episode_id, "mode": mode, "rejected": take.rejected}
    if take.run is None:
        return {**head, **scenario_numbers(take.scenario)}
    return {**head, **run_numbers(take.run), "drive_ms": round(take.drive_ms, 2)}


def _print(numbers: Numbers, written: Sequence[Path]) -> None:
    table = Table(title=f"episode {numbers['episode']}, mode {numbers['mode']}", show_header=False)
    for name, value in _rows(numbers):
        table.add_row(name, value)
    console = Console(highlight=False)
    console.print(table)
    for path in written:
        console.print(f"Open {path}.", markup=False, soft_wrap=True)


def _rows(numbers: Numbers) -> list[tuple[str, str]]:
    rows = [("goal", f"{numbers['goal_distance_m']:.2f} m away")]
    if "outcome" in numbers:
        share = 100 * numbers["human_visible_share"]
        rows.insert(0, ("outcome", f"{numbers['outcome'].replace('_', ' ')} after {numbers['duration_s']:.2f} s"))
        rows.append(("way", f"{numbers['path_length_m']:.2f} m"))
        replans = f"{numbers['replans']}, {numbers['ways']} different ways"
        if numbers["replans"]:
            replans += f"; p50 {numbers['replan_p50_ms']:.2f} ms, p99 {numbers['replan_p99_ms']:.2f} ms"
        rows.append(("replans", replans))
        rows += [("a person in view", f"{share:.0f} % of the time")] if numbers["humans"] else []
    rows += [(f"person {k}", _human_row(human)) for k, human in enumerate(numbers["humans"], start=1)]
    left_out = f"no: {numbers['rejected'].replace('_', ' ')}" if numbers["rejected"] else "yes"
    return [*rows, ("recorded by generate", left_out)]


def _human_row(human: Numbers) -> str:
    text = f"{human['avatar']}, {human['encounter']}, {human['speed_mps']:.2f} m/s"
    if "closest_m" not in human:
        return text
    seen = ", ".join(f"{begin:.2f}-{end:.2f} s" for begin, end in human["visible_s"]) or "never"
    return f"{text}; closest {human['closest_m']:.2f} m at {human['closest_s']:.2f} s; in view {seen}"
