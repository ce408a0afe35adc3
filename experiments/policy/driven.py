"""One policy in the same episodes three times: in the evaluator, rehearsed, and by `readygo drive` over Zenoh.

    python -m experiments.policy.driven SCENE POLICY --episodes 50 --out FOLDER --json FILE

`evaluator` is `readygo evaluate`, whose images come at once. `rehearsed` is `readygo simulate-robot --rehearse`: what
`readygo drive` does, in simulated time, with images that are late or lost as on a robot. `driven` are two programs, one
that is the robot and one that drives it, in real time, with the same images; each task has a separate robot, and the
robots run side by side. Outcomes of `driven` are kept in FOLDER with the logs of the trials; each row is beside the
evaluator's.
"""

import argparse
import json
import re
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from readygo.apps.drive.trial_log import RECORD
from readygo.benchmarks.rasterizer.render import machine
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.dataset.ros_log import read_record
from readygo.common.episode.metrics import wilson_interval
from readygo.common.files import write_whole
from readygo.common.messages import Outcome
from readygo.services.evaluator.records import record_of_mapping
from readygo.services.evaluator.results import RECORDS_FILE
from readygo.services.evaluator.statistics import mcnemar_p

EVALUATOR, REHEARSED, DRIVEN = "evaluator", "rehearsed", "driven"
LINE = re.compile(r"^(\w+) (\S+): (\w+) after ([\d.]+) s$")
"""What `readygo simulate-robot` says of an episode that has ended."""
READYGO = (sys.executable, "-m", "readygo")
WAITS = "a robot waits"
ENDS_S = 60.0
"""Time within which a robot ends after its last drive [s]."""
OUTCOMES_FILE = "outcomes.txt"


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How an episode ended."""

    outcome: Outcome
    time_s: float
    """Simulated time since it began [s]."""


Endings = dict[str, dict[str, Ending]]
"""How each episode ended, by task and name of the episode."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is compared."""

    scene: str
    policy: Path
    out: Path
    episodes: int
    """Per task."""
    tasks: Sequence[str]
    seed: int

    @property
    def drawn(self) -> tuple[str, ...]:
        """Options that say which episodes."""
        return ("--episodes", str(self.episodes), "--seed", str(self.seed))


def endings_of(lines: Iterable[str]) -> Endings:
    """What `readygo simulate-robot` said."""
    found: Endings = {}
    for line in lines:
        if match := LINE.match(line.strip()):
            task, episode, outcome, time_s = match.groups()
            found.setdefault(task, {})[episode] = Ending(outcome=Outcome(outcome), time_s=float(time_s))
    return found


def evaluated(job: Job) -> Endings:
    """How the evaluator's episodes ended."""
    out = job.out / EVALUATOR
    options = (*job.drawn, "--tasks", *job.tasks, "--methods", "policy", "--out", str(out))
    subprocess.run([*READYGO, "evaluate", job.scene, str(job.policy), *options], check=True, stdout=subprocess.DEVNULL)
    found: Endings = {}
    for line in (out / RECORDS_FILE).read_text().splitlines():
        record = record_of_mapping(json.loads(line))
        ending = Ending(outcome=record.result.outcome, time_s=record.result.duration_s)
        found.setdefault(record.task.value, {})[record.episode.episode_id] = ending
    return found


def rehearsed(job: Job) -> Endings:
    """How they end in `readygo simulate-robot --rehearse`."""
    command = [*READYGO, "simulate-robot", job.scene, str(job.policy), *job.drawn, "--tasks", *job.tasks, "--rehearse"]
    return endings_of(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines())


def driven(job: Job) -> Endings:
    """How they end over Zenoh, the tasks side by side; read from FOLDER where that is done."""
    threads = [threading.Thread(target=_drive_task, args=(job, task)) for task in job.tasks if not _kept(job, task)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if missing := [task for task in job.tasks if not _kept(job, task)]:
        sys.exit(f"The robot of {', '.join(missing)} ended before its episodes were over.")
    found: Endings = {}
    for task in job.tasks:
        found |= endings_of(_kept(job, task))
    return found


def _kept(job: Job, task: str) -> list[str]:
    path = job.out / task / OUTCOMES_FILE
    return path.read_text().splitlines() if path.is_file() else []


def _drive_task(job: Job, task: str) -> None:
    """Be a robot, and drive it from trial to trial until its episodes are over; what ends before that is not kept."""
    endpoint, folder = free_endpoint(), job.out / task
    folder.mkdir(parents=True, exist_ok=True)
    # `readygo drive` writes over no log.
    for log in folder.glob("*.mcap"):
        log.unlink()
    command = [*READYGO, "simulate-robot", job.scene, str(job.policy), *job.drawn, "--tasks", task]
    with subprocess.Popen([*command, "--listen", endpoint], stdout=subprocess.PIPE, text=True) as robot:
        assert robot.stdout
        if not any(WAITS in line for line in robot.stdout):
            return
        said: list[str] = []
        hears = threading.Thread(target=said.extend, args=(robot.stdout,))
        hears.start()
        for number in range(job.episodes):
            goal = ("--goal-topic", "/goal_pose", "--outcome-topic", "/outcome", "--task", task)
            kept = ("--connect", endpoint, "--log", str(folder / f"{number:03d}.mcap"))
            subprocess.run([*READYGO, "drive", str(job.policy), *goal, *kept], check=False, stdout=subprocess.DEVNULL)
        hears.join(ENDS_S)
        if hears.is_alive():
            # It has episodes left: a drive failed before its trial began.
            robot.terminate()
            hears.join()
    if robot.returncode == 0:
        write_whole(folder / OUTCOMES_FILE, "".join(said))


def latencies(job: Job) -> dict[str, float]:
    """Time from image to command over all trials [ms]: the median of medians, and the worst 99th percentile."""
    logs = [path for task in job.tasks for path in sorted((job.out / task).glob("*.mcap"))]
    measured = [measures for path in logs if (measures := read_record(path, RECORD)["measures"])]
    medians, p99s = ([measures[key] for measures in measured] for key in ("latency_median_ms", "latency_p99_ms"))
    return {"median_ms": float(np.median(medians)), "p99_median_ms": float(np.median(p99s)), "p99_max_ms": max(p99s)}


def measures_of(endings: Mapping[str, Ending]) -> dict[str, Any]:
    """Shares of outcomes, as docs/tables.md shows them."""
    count, outcomes = len(endings), Counter(ending.outcome for ending in endings.values())
    low, high = wilson_interval(outcomes[Outcome.SUCCESS], count)
    shares = {kind.value: {"mean": outcomes[kind] / count} for kind in Outcome if kind is not Outcome.SUCCESS}
    return {"success": {"mean": outcomes[Outcome.SUCCESS] / count, "low": low, "high": high, "count": count}} | shares


def compared(found: Mapping[str, Endings], tasks: Sequence[str]) -> dict[str, Any]:
    """The measures of all rows, and each beside the evaluator's in the episodes that both have.

    Args:
        found: Endings by row.
        tasks: In their order.
    """
    measures = {task: {row: measures_of(endings[task]) for row, endings in found.items()} for task in tasks}
    beside = [
        _beside(task, row, found[row][task], found[EVALUATOR][task])
        for task in tasks
        for row in found
        if row != EVALUATOR
    ]
    return {"measures": measures, "comparisons": beside}


def _beside(task: str, row: str, here: Mapping[str, Ending], there: Mapping[str, Ending]) -> dict[str, Any]:
    both = [(here[name].outcome, there[name].outcome) for name in here if name in there]
    wins = [(first is Outcome.SUCCESS, second is Outcome.SUCCESS) for first, second in both]
    only_here, only_there = wins.count((True, False)), wins.count((False, True))
    return {
        "task": task,
        "method": row,
        "reference": EVALUATOR,
        "episodes": len(both),
        "only_method": only_here,
        "only_reference": only_there,
        "mcnemar_p": mcnemar_p(only_here, only_there),
    }


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("policy", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--tasks", nargs="+", default=["static", "dynamic"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    arguments = vars(parser.parse_args())
    file = arguments.pop("json")
    job = Job(**arguments)
    try:
        found = {EVALUATOR: evaluated(job), REHEARSED: rehearsed(job), DRIVEN: driven(job)}
    except subprocess.CalledProcessError as error:
        # The command has said why.
        sys.exit(error.returncode)
    result = compared(found, job.tasks) | {"latency": latencies(job)}
    sys.stdout.write(json.dumps(result, indent=1) + "\n")
    if file is not None:
        command = f"python -m experiments.policy.driven {Path(job.scene).name} POLICY --episodes {job.episodes}"
        write_whole(file, json.dumps({"machine": machine(), "command": command, **result}, indent=1) + "\n")


if __name__ == "__main__":
    main()
