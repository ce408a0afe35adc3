"""Policies of equal budget and several seeds that differ in what they learn from, tried in the same episodes.

An arm is what the data of its policies are recorded in: scenes and settings. One policy on states labels all data, and
drives, pushed off its way: that of --teacher, or one that `readygo rl` trains where the policies are tried. From the
data of an arm each seed trains perception and then a policy whose encoder that is (recipe `pretrained`); the policy of
seed 0 drives more episodes (DAgger), and the policies of all seeds learn from all of it. All of them are tried in the
same episodes of the split test, among the two avatars of whom no data have one, beside the expert. The same command
resumes where it was stopped; in a folder of another comparison it ends in a line. It prints one line of JSON for every
policy and task, then one for every arm over its seeds, with 95 % intervals, and one for every comparison with the first
arm; `--json FILE` writes all of it.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from readygo.benchmarks.rasterizer.render import machine
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import ReadygoError, RunError
from readygo.common.files import write_whole
from readygo.common.messages import Outcome
from readygo.runs.teacher import teacher_ref
from readygo.services.evaluator import EXPERT, EpisodeRecord
from readygo.services.evaluator.records import record_of_mapping
from readygo.services.evaluator.results import RECORDS_FILE
from readygo.services.evaluator.scores import compare_all, comparison_mapping, score_mapping, scores_of

PARTS = ("crowd", "paper", "driven")
"""Parts of an arm's data in each of its scenes; a policy drives the last one."""
CAMERA = "[camera]\nheight_px = 72\nwidth_px = 128\n"
Chain = Sequence[Sequence[object]]
"""Arguments of commands of readygo that follow each other."""
JOB_FILE, CAMERA_FILE = "comparison.json", "robot.toml"
RESAMPLES = 10_000
"""Resamples of episodes and seeds behind an interval of an arm."""


@dataclass(frozen=True, kw_only=True)
class Arm:
    """What the data of some policies are recorded in."""

    scenes: tuple[str, ...]
    settings: str = ""
    """Settings of the recording, as in run.toml."""
    crowded: bool = True
    """True if the first part of the data has the mix "crowd", not "paper"."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is compared, and at what budget."""

    scene: str
    """Where policies are tried."""
    arms: Mapping[str, Arm]
    """By name; the others are compared with the first one."""
    teacher: Path | None = None
    """Folder of the policy on states that labels all data; None lets one learn in `scene`."""
    out: Path
    seeds: int
    """Trainings of each arm."""
    episodes: int
    """Episodes of each part of an arm's data in each of its scenes."""
    decisions: int
    """Decisions from which the policy on states learns, without `teacher`."""
    perception_samples: int
    """Samples that each perception is shown."""
    policy_samples: int
    """Samples that each policy is shown."""
    test: int
    """Episodes per task."""
    tasks: tuple[str, ...]
    """Tasks that are driven."""
    workers: int

    @property
    def budget(self) -> dict[str, Any]:
        """What networks and records depend on."""
        kept = {name: value for name, value in asdict(self).items() if name not in ("out", "tasks", "workers")}
        taught = {"teacher": self.teacher and teacher_ref(self.teacher).sha256}
        mapping: dict[str, Any] = json.loads(json.dumps({**kept, **taught}))
        return mapping

    @property
    def reference(self) -> str:
        """The arm that the others are compared with."""
        return next(iter(self.arms))


def prepare(job: Job) -> None:
    """Write what is compared, the robot, and the settings of the arms.

    Raises:
        RunError: If the folder is that of another comparison.
    """
    path, wanted = job.out / JOB_FILE, job.budget
    before = json.loads(path.read_text()) if path.is_file() else wanted
    if changed := [f"{name} {before.get(name)}" for name in wanted if before.get(name) != wanted[name]]:
        raise RunError(f"{job.out} was begun with {', '.join(changed)}; give another --out.")
    write_whole(path, json.dumps(wanted, indent=1) + "\n")
    write_whole(job.out / CAMERA_FILE, CAMERA)
    for name, arm in job.arms.items():
        write_whole(job.out / f"{name}.toml", arm.settings)


def commands(job: Job) -> Iterator[list[Chain]]:
    """What is run: steps, each of chains that may run side by side, each of commands that follow each other."""
    learns = ("rl", job.scene, "--robot", job.out / CAMERA_FILE, "--decisions", job.decisions, "--out", _teacher(job))
    yield [[["avatar", "vary", "embedded:train", "--out", job.out / "people"]], [] if job.teacher else [learns]]
    yield [[command] for name, arm in job.arms.items() for command in _undriven(job, name, arm)]
    # The first policy is that of seed 0.
    yield [
        [_perceive(job, name, seed), *(_learn(job, name, 0, first=True) if seed == 0 else ())]
        for seed, name in _trained(job)
    ]
    yield [
        [_record(job, name, scene, "driven", "--policy", _first(job, name), "--mix", 0.8)]
        for name, arm in job.arms.items()
        for scene in arm.scenes
    ]
    yield [_learn(job, name, seed) for seed, name in _trained(job)]


def run(job: Job) -> dict[str, Any]:
    """Do all of it; measures by arm, seed and task, and comparisons."""
    prepare(job)
    for chains in commands(job):
        with ThreadPoolExecutor(job.workers) as pool:
            list(pool.map(_run_chain, chains))
    names = [policy_name(name, seed) for seed, name in _trained(job)]
    _readygo(
        *("evaluate", job.scene, "--out", job.out / "test", "--checkpoints", job.out / "policies"),
        *("--episodes", job.test, "--tasks", *job.tasks, "--methods", *names, EXPERT, "--workers", job.workers),
        *("--robot", job.out / CAMERA_FILE, "--avatars", "embedded:test", "--renderer.detail", "lod"),
    )
    lines = (job.out / "test" / RECORDS_FILE).read_text().splitlines()
    return tables([record_of_mapping(json.loads(line)) for line in lines], list(job.arms), job.seeds)


def tables(records: Sequence[EpisodeRecord], arms: Sequence[str], seeds: int) -> dict[str, Any]:
    """Scores of every policy, of the arms over their seeds, and of each arm beside the first one."""
    limit_s, reference = EpisodeConfig().time_limit_s, arms[0]
    ordered = sorted(records, key=lambda r: (r.task.value, r.method, r.episode.index))
    rows = {}
    for task in dict.fromkeys(record.task.value for record in ordered):
        won = {arm: _won(ordered, task, arm, seeds) for arm in arms}
        rows[task] = {arm: _arm_row(won[arm], won[reference]) for arm in arms}
    compared = compare_all(ordered, policy_name(reference, 0), time_limit_s=limit_s)
    return {
        "measures": score_mapping(scores_of(ordered, time_limit_s=limit_s)),
        "arms": rows,
        "comparisons": [comparison_mapping(comparison) for comparison in compared],
    }


def policy_name(arm: str, seed: int) -> str:
    """Name of a policy as a method of the evaluation."""
    return f"{arm}/{seed}"


def _won(records: Sequence[EpisodeRecord], task: str, arm: str, seeds: int) -> np.ndarray:
    """Which episodes the policies of an arm solved, shape (seeds, episodes)."""
    rows = [
        [
            record.result.outcome is Outcome.SUCCESS
            for record in records
            if (record.task.value, record.method) == (task, policy_name(arm, seed))
        ]
        for seed in range(seeds)
    ]
    return np.array(rows, float)


def _arm_row(won: np.ndarray, reference: np.ndarray) -> dict[str, Any]:
    """Mean success of an arm [%], and how much less it is than the reference's, both over seeds and episodes.

    Intervals are of means over seeds and episodes drawn with replacement, the episodes the same for both.
    """
    rng, (seeds, episodes) = np.random.default_rng(0), won.shape
    means = np.empty((RESAMPLES, 2))
    for k in range(RESAMPLES):
        columns = rng.integers(episodes, size=episodes)
        ours, theirs = rng.integers(seeds, size=(2, seeds))
        means[k] = won[ours][:, columns].mean(), reference[theirs][:, columns].mean()
    low, high = 100 * np.quantile(means[:, 0], (0.025, 0.975))
    lost_low, lost_high = 100 * np.quantile(means[:, 1] - means[:, 0], (0.025, 0.975))
    return {
        "success": {"mean": 100 * won.mean(), "low": low, "high": high},
        "of_seeds": (100 * won.mean(axis=1)).tolist(),
        "less_than_first": {"mean": 100 * (reference.mean() - won.mean()), "low": lost_low, "high": lost_high},
    }


def _trained(job: Job) -> list[tuple[int, str]]:
    """Seed and arm of every training: all arms of a seed before the next seed."""
    return [(seed, arm) for seed in range(job.seeds) for arm in job.arms]


def _first(job: Job, arm: str) -> Path:
    """The policy that drives an arm's last data."""
    return job.out / "first" / arm


def _perception(job: Job, arm: str, seed: int) -> Path:
    return job.out / "perception" / arm / str(seed)


def _teacher(job: Job) -> Path:
    """The policy on states."""
    return job.teacher or job.out / "teacher"


def _data(job: Job, arm: str, scene: str, part: str) -> Path:
    return job.out / "data" / arm / Path(scene.replace(":", "-")).name / part


def _undriven(job: Job, name: str, arm: Arm) -> Iterator[list[object]]:
    """Record what no policy from images drives: half of it with more people, if the arm is crowded."""
    crowd = ("--people", "crowd") if arm.crowded else ()
    for scene in arm.scenes:
        yield _record(job, name, scene, "crowd", *crowd)
        yield _record(job, name, scene, "paper")


def _record(job: Job, arm: str, scene: str, part: str, *more: object) -> list[object]:
    """Record a part of an arm's data."""
    return [
        *("generate", scene, "--out", _data(job, arm, scene, part), "--episodes", job.episodes, *more),
        *("--seed", PARTS.index(part), "--config", job.out / f"{arm}.toml", "--robot", job.out / CAMERA_FILE),
        *("--avatars", job.out / "people", "--teacher", _teacher(job), "--workers", 0),
        *("--driver.camera-hz", 5, "--driver.disturbed", 0.7, "--renderer.detail", "lod", "--renderer.labels", "false"),
    ]


def _recorded(job: Job, arm: str, parts: Sequence[str]) -> list[Path]:
    return [_data(job, arm, scene, part) for scene in job.arms[arm].scenes for part in parts]


def _perceive(job: Job, arm: str, seed: int) -> list[object]:
    """Train an arm's perception."""
    return [
        *("train", *_recorded(job, arm, PARTS[:2]), "--recipe", "perception", "--samples", job.perception_samples),
        *("--seed", seed, "--threads", 1, "--out", _perception(job, arm, seed)),
    ]


def _learn(job: Job, arm: str, seed: int, first: bool = False) -> Chain:
    """Train an arm's policy: from what the teacher drove, or from all data."""
    out = _first(job, arm) if first else job.out / "policies" / arm / str(seed)
    return [
        [
            *("train", *_recorded(job, arm, PARTS[:2] if first else PARTS), "--recipe", "pretrained"),
            *("--samples", job.policy_samples, "--perception", _perception(job, arm, seed)),
            *("--seed", seed, "--threads", 1, "--out", out),
        ]
    ]


def _run_chain(chain: Chain) -> None:
    for command in chain:
        _readygo(*command)


def _readygo(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "readygo", *map(str, arguments)], check=True, stdout=sys.stderr)


def parser_of(description: str | None) -> argparse.ArgumentParser:
    """Options of all comparisons."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=160)
    parser.add_argument("--teacher", type=Path)
    parser.add_argument("--decisions", type=int, default=12_582_912)
    parser.add_argument("--perception-samples", type=int, default=100_000)
    parser.add_argument("--policy-samples", type=int, default=2_000_000)
    parser.add_argument("--test", type=int, default=100)
    parser.add_argument("--tasks", nargs="+", default=["static", "dynamic"])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--arms", nargs="+", metavar="ARM", help="the arms to compare; all without it")
    parser.add_argument("--json", type=Path)
    return parser


def main(name: str, options: Mapping[str, Any], arms: Mapping[str, Arm]) -> None:
    """Run a comparison, and print and write what it finds.

    Args:
        name: The comparison's module.
        options: Values of the options of `parser_of`.
        arms: See `Job`.
    """
    options = dict(options)
    file, tasks, chosen = options.pop("json"), tuple(options.pop("tasks")), options.pop("arms") or list(arms)
    if unknown := [arm for arm in chosen if arm not in arms]:
        sys.exit(f"There is no arm {unknown[0]}; there are {', '.join(arms)}.")
    job = Job(**options, tasks=tasks, arms={arm: arms[arm] for arm in chosen})
    try:
        found = run(job)
    except ReadygoError as error:
        sys.exit(str(error))
    except subprocess.CalledProcessError as error:
        # The command has said why.
        sys.exit(error.returncode)
    _print_table(found)
    if file is not None:
        command = f"python -m experiments.policy.{name} {Path(job.scene).name}"
        kept = {"machine": machine(), "command": command, **job.budget, "scene": Path(job.scene).name, **found}
        write_whole(file, json.dumps(kept, indent=1) + "\n")


def _print_table(found: Mapping[str, Any]) -> None:
    for task, methods in found["measures"].items():
        for method, scores in methods.items():
            print(json.dumps({"task": task, "method": method, **scores}))
    for task, arms in found["arms"].items():
        for arm, row in arms.items():
            print(json.dumps({"task": task, "arm": arm, **row}))
    for comparison in found["comparisons"]:
        print(json.dumps(comparison))
