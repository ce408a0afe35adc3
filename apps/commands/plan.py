"""`readygo plan`: one episode of the expert, planned again and explained."""

import dataclasses
import json as json_module
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from readygo.apps.commands.scene_argument import open_maps
from readygo.apps.run.config import RunConfig, load_run_config
from readygo.common.avatars import Avatar, load_avatars
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.drawing.files import write_png
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.errors import RunError
from readygo.common.messages import (
    AnimateRequest,
    EpisodeKey,
    HumanPlanRequest,
    Outcome,
    Scenario,
    Split,
)
from readygo.common.robot import load_robot
from readygo.common.robot.kinematics import DT_S
from readygo.common.scenes import Scene
from readygo.services.animator import Animator, handle_animate
from readygo.services.planner import ExpertConfig, Planner, handle_human_plan
from readygo.services.planner.explain.journal import ExpertRun, run_with_journal
from readygo.services.planner.explain.picture import draw_episode, draw_run
from readygo.services.planner.handlers import SceneMaps, drive
from readygo.services.planner.humans.scenario_file import save_scenarios

Numbers = dict[str, Any]


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
        video: MP4 to write: the same over time, in real time.
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
    stage = _open_stage(scene, run_config, avatars, static=static)
    take = _take(stage, episode, static=static)
    numbers = _numbers(take, stage)
    if picture is not None:
        write_png(picture, _picture(take, stage))
    if video is not None:
        _write_video(video, take, stage, camera=camera)
    if export is not None:
        save_scenarios(export, [take.scenario])
    if json:
        sys.stdout.write(json_module.dumps(numbers, indent=2) + "\n")
    else:
        _print(numbers, [path for path in (picture, video, export) if path is not None])


def _check(scene: str, index: int, seed: int, *, camera: bool, video: Path | None) -> None:
    """Raise RunError if the arguments make no sense."""
    if index < 0 or not 0 <= seed < 2**63:
        raise RunError(f"--index must be at least 0 and --seed 0..2^63-1, got {index} and {seed}.")
    if camera and video is None:
        raise RunError("--camera shows the robot's view in a video: say where with --video FILE.mp4.")
    if camera and scene.endswith((".yaml", ".yml")):
        raise RunError(f"--camera needs a scene bundle to draw: {scene} is a map.")


def _check_endings(picture: Path | None, video: Path | None, export: Path | None) -> None:
    """Raise RunError if a file's name does not say what it will be."""
    files = (("--picture", picture, ".png"), ("--video", video, ".mp4"), ("--export", export, ".toml"))
    for option, path, ending in files:
        if path is not None and path.suffix.lower() != ending:
            raise RunError(f"{option} {path} must end in {ending}.")


def _with_mode(expert: ExpertConfig, mode: str) -> ExpertConfig:
    return section_from_mapping(ExpertConfig, {**section_to_mapping(expert), "mode": mode}, where="--")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stage:
    """Where episodes take place."""

    config: RunConfig
    scene: Scene | None
    """None for a bare map."""
    maps: SceneMaps
    avatars: dict[str, Avatar]
    planner: Planner


@dataclass(frozen=True, kw_only=True, eq=False)
class _Take:
    """One episode, as far as it got."""

    scenario: Scenario
    run: ExpertRun | None
    rejected: str
    """Why `readygo generate` leaves it out; empty if it does not."""
    drive_ms: float
    """CPU time of the expert's whole run [ms]."""


def _open_stage(scene: str, config: RunConfig, avatars: Path | None, *, static: bool) -> _Stage:
    maps, bundle = open_maps(scene)
    people = {} if static else load_avatars(avatars)
    planner = Planner(
        maps=maps,
        avatars=people,
        robot=config.robot,
        episode_config=config.episode,
        human_config=config.human_planner,
        expert_config=config.expert,
    )
    return _Stage(config=config, scene=bundle, maps=maps, avatars=people, planner=planner)


def _take(stage: _Stage, episode: EpisodeKey, *, static: bool) -> _Take:
    """Draw the scenario, let people walk, drive.

    Raises:
        RunError: If this index has no scenario.
    """
    drawn = handle_human_plan(stage.planner, HumanPlanRequest(episode=episode, static=static))
    if drawn.scenario is None:
        raise RunError(f"Episode {episode.episode_id} has no scenario: {drawn.rejected}. Ask for another --index.")
    animator = Animator(avatars=stage.avatars, floor=stage.maps.floor, config=stage.config.animator)
    animated = handle_animate(animator, AnimateRequest(scenario=drawn.scenario))
    if animated.motions is not None:
        # Loads the compiled code, whose time is not the planner's.
        drive(stage.planner, drawn.scenario, animated.motions)
    run, rejected, drive_ms = None, animated.rejected, 0.0
    if animated.motions is not None:
        begin_s = time.thread_time()
        run = run_with_journal(stage.planner, drawn.scenario, animated.motions)
        drive_ms = 1e3 * (time.thread_time() - begin_s)
        outcome = run.trajectory.outcome
        rejected = "" if outcome is Outcome.SUCCESS else outcome.value
    return _Take(scenario=drawn.scenario, run=run, rejected=rejected, drive_ms=drive_ms)


def _picture(take: _Take, stage: _Stage) -> npt.NDArray[np.uint8]:
    if take.run is not None:
        return draw_run(stage.planner, take.run)
    return draw_episode(stage.maps.robot, take.scenario, robot=stage.config.robot, episode_config=stage.config.episode)


def _write_video(path: Path, take: _Take, stage: _Stage, *, camera: bool) -> None:
    """Film the run.

    Raises:
        RunError: If there is no run.
    """
    from readygo.apps.pictures.plan_film import camera_images, run_film
    from readygo.common.drawing.film import write_film

    if take.run is None:
        raise RunError(f"There is nothing to film in {take.scenario.episode.episode_id}: {take.rejected}.")
    images = None
    if camera:
        assert stage.scene is not None
        images = camera_images(stage.scene, stage.avatars, stage.config, take.run)
    write_film(path, run_film(stage.planner, take.run, images))


def _numbers(take: _Take, stage: _Stage) -> Numbers:
    """What happened, as plain values; what is not there is None."""
    scenario = take.scenario
    start, goal = scenario.start_xyyaw.tolist(), scenario.goal_xy_m.tolist()
    numbers: Numbers = {
        "episode": scenario.episode.episode_id,
        "mode": stage.config.expert.mode,
        "rejected": take.rejected,
        "start_xyyaw": [round(value, 4) for value in start],
        "goal_xy_m": [round(value, 4) for value in goal],
        "goal_distance_m": round(math.hypot(goal[0] - start[0], goal[1] - start[1]), 3),
        "humans": [_planned(scenario, k) for k in range(len(scenario.humans))],
    }
    if take.run is None:
        return numbers
    humans = [{**human, **_met(take.run, k)} for k, human in enumerate(numbers["humans"])]
    return {**numbers, **_driven(take.run), "drive_ms": round(take.drive_ms, 2), "humans": humans}


def _planned(scenario: Scenario, human: int) -> Numbers:
    who = scenario.humans[human]
    return {"avatar": who.avatar, "encounter": who.encounter, "speed_mps": round(who.speed_mps, 3)}


def _met(run: ExpertRun, human: int) -> Numbers:
    """How near a human came, and when the robot saw it."""
    gap_m = run.gap_m(human)
    closest = int(np.argmin(gap_m))
    return {
        "closest_m": round(float(gap_m[closest]), 3),
        "closest_s": round(closest * DT_S, 2),
        "visible_s": [[round(a * DT_S, 2), round(b * DT_S, 2)] for a, b in _spans(run.journal.seen(human))],
    }


def _driven(run: ExpertRun) -> Numbers:
    trajectory = run.trajectory
    times_ms = 1e3 * trajectory.replan_times_s
    return {
        "outcome": trajectory.outcome.value,
        "duration_s": round(trajectory.duration_s, 2),
        "path_length_m": round(EpisodeResult.from_trajectory(trajectory, 0.0).path_length_m, 3),
        "replans": int(trajectory.replanned.sum()),
        "ways": len(run.journal.changes),
        "replan_p50_ms": round(float(np.percentile(times_ms, 50)), 3) if len(times_ms) else None,
        "replan_p99_ms": round(float(np.percentile(times_ms, 99)), 3) if len(times_ms) else None,
        "human_distance_min_m": _finite(float(trajectory.human_distance_m.min())),
        "time_to_collision_min_s": _finite(float(trajectory.time_to_collision_s.min())),
        "human_visible_share": round(float(trajectory.human_visible.mean()), 3),
    }


def _spans(flags: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of the stretches of True; the end is the first False behind."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _finite(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None


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
