"""`readygo demo`: the whole job on the embedded scene, small enough for a coffee break."""

import json
import shutil
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from readygo.apps.commands.generate import progress_bar
from readygo.apps.demo.report import write_report
from readygo.apps.demo.report_content import Command, ReportContent, RunNumbers, Score, StripImage
from readygo.apps.fleet.run import record
from readygo.apps.pages.charts import LossCurve
from readygo.apps.pictures.episode_film import EpisodeFilm, film_frames
from readygo.apps.run.config import RunConfig
from readygo.apps.run.evaluation import make_evaluator, summarize
from readygo.apps.run.scene_argument import open_scene
from readygo.apps.run.spec import make_spec
from readygo.apps.run.training import make_config, run_training
from readygo.apps.run.warm import warm_all
from readygo.apps.run.world import World
from readygo.common.dataset import Dataset, EpisodeEntry, validate
from readygo.common.drawing.film import write_animation, write_film
from readygo.common.drawing.plan_view import DrawnEpisode
from readygo.common.errors import DatasetError, RunError
from readygo.common.files import write_whole
from readygo.common.frames import wrap_angle
from readygo.common.messages import AnimateRequest, HumanPlanRequest, Scenario, Split
from readygo.common.policy import load_policy
from readygo.common.robot.kinematics import DT_S
from readygo.common.scenes.top_view import top_view
from readygo.services.animator import handle_animate
from readygo.services.evaluator import (
    EvaluateReply,
    EvaluateRequest,
    Method,
    handle_evaluate,
    summary_table,
    write_results,
)
from readygo.services.planner import handle_human_plan

MARKER = ".readygo-demo"
"""File that says that a folder is a demo's, and may be replaced."""
TASK_NAMES = {"static": "static", "dynamic": "with people"}
_CLOSE_UP_RAD = 0.6
"""A person this far from the middle of the image is shown well [rad]."""
ANIMATION_SCALE, ANIMATION_STEP = 2, 2
"""Enlargement of the robot's view in the report's film, and rows from image to image."""
STRIP_STEPS = (-30, -22, -15, -9, -4, 0)
"""Samples of the film strip, around the moment at which a visible person is nearest."""


@dataclass(frozen=True, kw_only=True)
class _Timer:
    console: Console
    begin_s: float

    def say(self, text: str) -> None:
        self.console.print(f"[bold]{time.monotonic() - self.begin_s:5.0f} s[/bold]  {text}")


def demo(
    *,
    out: Path = Path("demo"),
    episodes: int = 20,
    workers: int = 1,
    train_minutes: float = 1.5,
    evaluate_episodes: int = 4,
) -> None:
    """Generate, train and evaluate on the embedded scene, and write a report and a film.

    Args:
        out: Folder for report.html, episode.mp4 and what they are made from; an earlier demo in it is replaced.
        episodes: Episodes to record.
        workers: Renderer processes, besides one process for each other role.
        train_minutes: Training time [min].
        evaluate_episodes: Matched episodes per task.

    Raises:
        RunError: If `out` holds files of something else.
    """
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    timer = _Timer(console=console, begin_s=time.monotonic())
    _clear(out)
    timer.say("compiling kernels (once per machine) and building the embedded scene")
    warm_all()
    config = RunConfig()
    spec = make_spec(open_scene("embedded"), None, config, seed=0, split=Split.TRAIN, static=False)
    timer.say(f"recording {episodes} episodes with a fleet over Zenoh: 5 processes and {workers} renderer(s)")
    with progress_bar() as show:
        run = record(spec, out / "data", episodes=episodes, workers=workers, show=show)
    report = validate(out / "data")
    if not report.ok:
        raise DatasetError(f"{out / 'data'} has defects, the first: {report.defects[0]}")
    timer.say(f"{run['samples']} samples are recorded and sound; training for {train_minutes:g} min")
    metrics = run_training(Dataset(out / "data"), make_config("fast", minutes=train_minutes), out / "policy")
    timer.say("evaluating policy, expert and straight line on matched test episodes")
    reply = _evaluate(out, config, evaluate_episodes)
    timer.say("drawing the report")
    commands = _commands(out, episodes, workers, train_minutes, evaluate_episodes)
    _write_pictures(out, World(spec), run, metrics, reply, workers=workers, commands=commands)
    console.print(summary_table(reply.summaries))
    timer.say("done")
    sys.stdout.write(
        f"Open {out / 'report.html'} and {out / 'episode.mp4'}.\n"
        "Next, your own place: readygo scene import SCENE.ply --out out/place && "
        "readygo generate out/place --episodes 400 --out out/data\n"
    )


def _clear(out: Path) -> None:
    """Remove an earlier demo; folders that no demo has made stay untouched."""
    marker = out / MARKER
    if out.exists() and any(out.iterdir()) and not marker.exists():
        raise RunError(f"{out} holds files of something else; choose an empty or new folder with --out.")
    out.mkdir(parents=True, exist_ok=True)
    marker.touch()
    for name in ("data", "policy", "evaluation"):
        shutil.rmtree(out / name, ignore_errors=True)


def _evaluate(out: Path, config: RunConfig, episodes: int) -> EvaluateReply:
    policy = load_policy(out / "policy")
    evaluator = make_evaluator("embedded", config, avatars=None, seed=0, policy=policy)
    request = EvaluateRequest(episodes=episodes, seed=0)
    reply = handle_evaluate(evaluator, request)
    write_results(out / "evaluation", reply.records, summarize(reply, request, evaluator))
    return reply


def _write_pictures(
    out: Path,
    world: World,
    run: dict[str, Any],
    metrics: dict[str, Any],
    reply: EvaluateReply,
    *,
    workers: int,
    commands: tuple[Command, ...],
) -> None:
    dataset = Dataset([out / "data"])
    view = top_view(world.scene)
    recorded = dataset.provenance
    scenarios = _Scenarios(world)
    shown = _best_encounter(dataset, scenarios)
    film = _film(dataset, shown, scenarios)
    write_film(out / "episode.mp4", film_frames(film, view))
    frames = film_frames(film, view, camera_scale=ANIMATION_SCALE, step=ANIMATION_STEP)
    write_animation(out / "episode.webp", frames, step=ANIMATION_STEP)
    content = ReportContent(
        title="readygo demo",
        subtitle="A robot policy for a place with walking people, from that place's Gaussians alone: recorded by a "
        "fleet of workers, trained, and evaluated in closed loop on this machine.",
        scene_name=world.scene.name,
        scene_note=f"{len(world.scene.cloud):,} Gaussians, made by code; {len(world.avatars)} people can walk in it.",
        top_view=view,
        occupancy=world.scene.maps.robot,
        episodes=tuple(_drawn(dataset, entry, scenarios) for entry in dataset.episodes[:6]),
        strip=_strip(dataset, shown, scenarios),
        strip_note=f"Episode {shown.episode.episode_id}, as recorded: {dataset.width_px}x{dataset.height_px}.",
        animation=out / "episode.webp",
        video=out / "episode.mp4",
        losses=_losses(metrics),
        loss_step_name="samples seen",
        training_note=_training_note(metrics),
        scores=_scores(reply),
        scores_note="A minute of training on a few episodes shows the way, not what a policy can do.",
        run=RunNumbers(
            episodes=run["episodes"],
            samples=run["samples"],
            wall_s=run["wall_s"],
            workers=workers + 5,
            rejected=run["rejected"],
            cpu_s_by_stage=run["cpu_s"],
        ),
        commands=commands,
        next_steps=_next_steps(),
        provenance={
            "readygo_version": recorded.readygo_version,
            "commit": recorded.commit,
            "numeric_class": recorded.numeric_class,
        },
    )
    write_report(out / "report.html", content)
    write_whole(out / "run.json", json.dumps(run, indent=2) + "\n")


class _Scenarios:
    """The people of recorded episodes, made again from their keys."""

    def __init__(self, world: World) -> None:
        self._planner, self._animator = world.human_planner(), world.animator()
        self._map = world.scene.maps.robot

    def sees(self, xy_m: tuple[float, float], offset_m: np.ndarray) -> bool:
        """True if nothing stands between a point and the point at an offset from it."""
        steps = max(2, int(np.hypot(*offset_m) / self._map.frame.resolution_m))
        cells = [self._map.frame.cell(*(xy_m + offset_m * share)) for share in np.linspace(0.0, 1.0, steps)]
        return not any(self._map.occupied[cell] for cell in cells)

    def humans(self, entry: EpisodeEntry) -> tuple[Scenario, tuple[np.ndarray, ...]]:
        """The scenario, and where its people walk, shape (T, 2) each."""
        scenario = handle_human_plan(self._planner, HumanPlanRequest(episode=entry.episode)).scenario
        assert scenario is not None
        motions = handle_animate(self._animator, AnimateRequest(scenario=scenario)).motions
        assert motions is not None
        return scenario, tuple(human.motion.root_m[:, :2].astype(np.float64) for human in motions.humans)


def _rows(entry: EpisodeEntry) -> slice:
    return slice(entry.first_sample, entry.first_sample + entry.sample_count)


def _nearness(dataset: Dataset, entry: EpisodeEntry, scenarios: _Scenarios) -> np.ndarray:
    """How well a person can be seen at each sample: in view, not hidden, and two to three metres away; -inf if not."""
    _, humans = scenarios.humans(entry)
    scores = np.full(entry.sample_count, -np.inf)
    for step, (x, y, _, yaw) in enumerate(dataset.poses[_rows(entry)].astype(np.float64)):
        for xy in humans:
            offset = xy[min(step, len(xy) - 1)] - (x, y)
            distance, bearing = np.hypot(*offset), wrap_angle(np.arctan2(offset[1], offset[0]) - yaw)
            if abs(bearing) < _CLOSE_UP_RAD and scenarios.sees((x, y), offset):
                scores[step] = max(scores[step], -abs(distance - 2.5))
    return scores


def _best_encounter(dataset: Dataset, scenarios: _Scenarios) -> EpisodeEntry:
    return max(dataset.episodes, key=lambda entry: float(np.sum(_nearness(dataset, entry, scenarios) > -1.2)))


def _film(dataset: Dataset, entry: EpisodeEntry, scenarios: _Scenarios) -> EpisodeFilm:
    scenario, humans = scenarios.humans(entry)
    rows = _rows(entry)
    poses = dataset.poses[rows]
    return EpisodeFilm(
        title=entry.episode.episode_id,
        camera=[dataset.decode(sample) for sample in range(rows.start, rows.stop)],
        xyyaw=poses[:, [0, 1, 3]].astype(np.float64),
        actions=dataset.actions[rows].astype(np.float64),
        goal_xy_m=scenario.goal_xy_m,
        humans_xy_m=humans,
        human_visible=dataset.truth["human_visible"][rows],
        replanned=dataset.truth["replanned"][rows],
        outcome="success",
    )


def _drawn(dataset: Dataset, entry: EpisodeEntry, scenarios: _Scenarios) -> DrawnEpisode:
    scenario, humans = scenarios.humans(entry)
    return DrawnEpisode(
        label=entry.episode.episode_id,
        robot_xy_m=dataset.poses[_rows(entry), :2].astype(np.float64),
        goal_xy_m=scenario.goal_xy_m,
        humans_xy_m=tuple(xy[: entry.sample_count] for xy in humans),
    )


def _strip(dataset: Dataset, entry: EpisodeEntry, scenarios: _Scenarios) -> tuple[StripImage, ...]:
    centre = int(np.argmax(_nearness(dataset, entry, scenarios)))
    first = min(max(centre, -STRIP_STEPS[0]), entry.sample_count - 1)
    steps = sorted({max(0, first + offset) for offset in STRIP_STEPS})
    return tuple(StripImage(rgb=dataset.decode(entry.first_sample + step), time_s=step * DT_S) for step in steps)


def _losses(metrics: dict[str, Any]) -> tuple[LossCurve, ...]:
    history = metrics["history"]
    samples = np.array([item["samples"] for item in history], dtype=np.float64)
    return tuple(
        LossCurve(name=name, step=samples, loss=np.array([item[key] for item in history], dtype=np.float64))
        for name, key in (("training", "train_loss"), ("held out", "validation_loss"))
    )


def _training_note(metrics: dict[str, Any]) -> str:
    return (
        f"{metrics['parameters']:,} parameters, {metrics['samples_seen']:,} samples in {metrics['elapsed_s']:.0f} s. "
        f"On held-out episodes the error is {100 * metrics['ratio_v']:.0f} % (v) and {100 * metrics['ratio_w']:.0f} % "
        "(w) of predicting the mean."
    )


def _scores(reply: EvaluateReply) -> tuple[Score, ...]:
    return tuple(
        Score(task=TASK_NAMES[task.value], driver=method.value.replace("-", " "), summary=summary)
        for (task, method), summary in reply.summaries.items()
        if method in Method
    )


def _commands(out: Path, episodes: int, workers: int, minutes: float, evaluated: int) -> tuple[Command, ...]:
    data, policy, options = out / "data", out / "policy", f"--episodes {episodes} --workers {workers}"
    evaluate = f"readygo evaluate embedded {policy} --episodes {evaluated} --out {out / 'evaluation'}"
    return (
        Command(what="record", line=f"readygo generate embedded {options} --out {data}"),
        Command(what="check", line=f"readygo validate {data}"),
        Command(what="train", line=f"readygo train {data} --minutes {minutes:g} --out {policy}"),
        Command(what="evaluate", line=evaluate),
    )


def _next_steps() -> tuple[Command, ...]:
    return (
        Command(what="bring a place", line="readygo scene import place.ply --name place --out out/place"),
        Command(what="look at it", line="readygo scene inspect out/place"),
        Command(what="record", line="readygo generate out/place --episodes 400 --workers 2 --out out/data"),
        Command(what="learn", line="readygo train out/data --minutes 60 --out out/policy"),
        Command(what="measure", line="readygo evaluate out/place out/policy --episodes 100"),
    )
