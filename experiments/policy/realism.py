"""What photoreal people and people who move are worth in training: policies of equal budget, tried among unseen people.

    python -m experiments.policy.realism SCENE --out FOLDER [--samples 400000] [--test 100]
        [--methods straight-line gnm]

Each arm learns by `readygo learn`, with its own states in its data, from as many samples as the others. The same
command resumes where it was stopped; in a folder of another scene, other people or another budget it ends in a line:

- photoreal: among six avatars as they are
- mesh: people as simple assets of a game engine ([renderer] human_look = "mesh"), as in Vid2Sim
- static: without people

All of them are tried in the same episodes of the split test, among photoreal people of whom no data have one
(`--unseen avatars`), beside the expert and what else `--methods` names: gnm, vint and nomad are trained on the data of
photoreal, `--network-samples` of them. Prints one line of JSON for every arm and task, then one for every comparison
with "photoreal": rates and means with 95 % intervals, McNemar's p. `--json FILE` writes all of it.
"""

import argparse
import dataclasses
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.benchmarks.rasterizer.render import machine
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import ReadygoError, RunError
from readygo.common.files import write_whole
from readygo.runs.methods import CHECKPOINTS, NETWORKS
from readygo.services.evaluator import EXPERT, POLICY, EpisodeRecord
from readygo.services.evaluator.records import record_of_mapping
from readygo.services.evaluator.results import RECORDS_FILE
from readygo.services.evaluator.scores import compare_all, comparison_mapping, score_mapping, scores_of

ARMS: Mapping[str, str] = {
    "photoreal": '[renderer]\nhuman_look = "photoreal"\n',
    "mesh": '[renderer]\nhuman_look = "mesh"\n',
    "static": "[human_planner]\nabsent = 1.0\n",
}
"""Settings of `readygo learn`, by arm."""
TASKS = ("static", "dynamic")
JOB_FILE = "comparison.json"


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is compared, and at what budget."""

    scene: str
    out: Path
    avatars: str
    """Folder of avatars, or "embedded"."""
    samples: int
    """Samples that each policy is shown, some of them more than once."""
    test: int
    """Episodes per task."""
    test_scenes: Sequence[str]
    """Scenes in which policies are tested."""
    methods: Sequence[str]
    """Methods that also drive, by the names of `readygo evaluate`."""
    network_samples: int
    """Samples that each published network is shown."""
    workers: int
    seed: int


def prepare(job: Job) -> None:
    """Write what is compared, and the settings of the arms: a small camera, people as photographs or as assets.

    Raises:
        RunError: If the folder is that of another comparison.
    """
    path = job.out / JOB_FILE
    found = {name: str(getattr(job, name)) for name in ("scene", "avatars", "samples", "seed")}
    before = json.loads(path.read_text()) if path.is_file() else found
    if changed := [f"{name} {before.get(name)}" for name in found if before.get(name) != found[name]]:
        raise RunError(f"{job.out} was begun with {', '.join(changed)}; give another --out.")
    write_whole(path, json.dumps(found, indent=1) + "\n")
    for arm, settings in ARMS.items():
        write_whole(_settings_file(job, arm), settings)


def _settings_file(job: Job, arm: str) -> Path:
    return job.out / f"{arm}.toml"


def make_policy(job: Job, arm: str) -> None:
    """Learn an arm's policy, or resume; does nothing if it has finished."""
    budget = ("--samples", job.samples, "--seed", job.seed, "--episodes", 0)
    people = ("--avatars", f"{job.avatars}:train")
    _readygo("learn", job.scene, "--out", job.out / arm, "--config", _settings_file(job, arm), *people, *budget)


def train_networks(job: Job) -> None:
    """Train the networks that are asked for on what the expert drove for the arm photoreal, unless that is done."""
    data = next((job.out / "photoreal" / "data").iterdir())
    for network in (name for name in job.methods if name in NETWORKS):
        if not (job.out / CHECKPOINTS / NETWORKS[network]).is_file():
            budget = ("--samples", job.network_samples, "--seed", job.seed)
            _readygo("train", data, "--recipe", network, "--out", job.out / CHECKPOINTS, *budget)


def evaluate(job: Job, arm: str, scene: str) -> list[EpisodeRecord]:
    """An arm's policy among photoreal people that it never saw; the records carry the arm's name."""
    out = job.out / f"{arm}-in-{Path(scene).name.replace(':', '-')}"
    methods = (POLICY, EXPERT, *job.methods) if arm == "photoreal" else (POLICY,)
    _readygo(
        *("evaluate", scene, job.out / arm / "policy", "--out", out, "--episodes", job.test, "--tasks", *TASKS),
        *(
            "--methods",
            *methods,
            "--config",
            _settings_file(job, "photoreal"),
            "--seed",
            job.seed,
            "--workers",
            job.workers,
        ),
        *("--avatars", f"{job.avatars}:test", "--unseen", "avatars", "--checkpoints", job.out / CHECKPOINTS),
    )
    lines = (out / RECORDS_FILE).read_text().splitlines()
    records = [record_of_mapping(json.loads(line)) for line in lines]
    named = [dataclasses.replace(r, method=arm) if r.method == POLICY else r for r in records]
    return sorted(named, key=lambda record: (TASKS.index(record.task.value), record.method, record.episode.index))


def tables(records: Sequence[EpisodeRecord]) -> dict[str, Any]:
    """Scores of the arms, and each beside "photoreal"."""
    limit_s = EpisodeConfig().time_limit_s
    compared = compare_all(records, "photoreal", time_limit_s=limit_s)
    return {
        "measures": score_mapping(scores_of(records, time_limit_s=limit_s)),
        "comparisons": [comparison_mapping(comparison) for comparison in compared],
    }


def _readygo(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "readygo", *map(str, arguments)], check=True, stdout=sys.stderr)


def _print_table(scene: str, found: Mapping[str, Any]) -> None:
    for task, methods in found["measures"].items():
        for method, scores in methods.items():
            print(json.dumps({"scene": scene, "task": task, "method": method, **scores}))
    for comparison in found["comparisons"]:
        print(json.dumps({"scene": scene, **comparison}))


def compare(job: Job) -> dict[str, Any]:
    """Do all of it; the tables by scene."""
    prepare(job)
    for arm in ARMS:
        make_policy(job, arm)
    train_networks(job)
    found = {}
    for scene in (job.scene, *job.test_scenes):
        name = Path(scene).name
        found[name] = tables([record for arm in ARMS for record in evaluate(job, arm, scene)])
        _print_table(name, found[name])
    return found


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--avatars", default="embedded")
    parser.add_argument("--samples", type=int, default=400_000)
    parser.add_argument("--test", type=int, default=100)
    parser.add_argument("--test-scenes", nargs="*", default=[])
    parser.add_argument("--methods", nargs="*", default=[])
    parser.add_argument("--network-samples", type=int, default=40_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    arguments = vars(parser.parse_args())
    file = arguments.pop("json")
    job = Job(**arguments)
    try:
        found = compare(job)
    except ReadygoError as error:
        sys.exit(str(error))
    except subprocess.CalledProcessError as error:
        # The command has said why.
        sys.exit(error.returncode)
    if file is not None:
        budget = {name: getattr(job, name) for name in ("samples", "network_samples", "test", "seed")}
        command = f"python -m experiments.policy.realism {Path(job.scene).name}"
        kept = {"machine": machine(), "command": command, **budget, "scenes": found}
        write_whole(file, json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
