"""What the policy costs and learns.

    python -m readygo.benchmarks.policy.policy cost
    ... learn --minutes 10 --out FOLDER

cost: parameters, training samples and frames per second, and milliseconds per control step of the exported policy, of
the recipe `best` beside the network for full images in float32 (CPU time of one thread; the recipes take turns).
learn: trains on an expert's episodes in toy rooms (`toy_rooms.py`), then drives in the same rooms between new starts
and goals, beside an expert and a straight line.
"""

import argparse
import dataclasses
import json
import math
import os
import tempfile
import time
from pathlib import Path

import numpy as np

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from readygo.benchmarks.policy.toy_rooms import Rooms, ToyTask, draw_task, drive, expert_command, make_rooms, record
from readygo.common.episode.metrics import wilson_interval
from readygo.common.episode.straight_line import straight_line_command
from readygo.common.policy import Policy, load_policy
from readygo.common.robot import RobotConfig
from readygo.services.trainer import RECIPES, TrainConfig, with_overrides
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.model import parameter_count
from readygo.services.trainer.parts import build_parts, timing_of
from readygo.services.trainer.run import TrainRun
from readygo.services.trainer.samples import draw_samples, make_batch
from readygo.services.trainer.train import train_policy, training_threads

ROOMS_SEED, BOXES = 3, 28


def measure_cost(samples: int) -> list[dict]:
    """Parameters, training speed and latency on one thread, of the network for full images in float32 and of `best`.

    The two take turns, so that a busy machine slows both.
    """
    rooms = make_rooms(RobotConfig(), seed=ROOMS_SEED, boxes=BOXES)
    source = record(rooms, 6, seed=0)
    recipes = {
        "fast, float32": dataclasses.replace(RECIPES["fast"](), precision="fp32"),
        "best, float32": dataclasses.replace(RECIPES["best"](), precision="fp32"),
        "best": RECIPES["best"](),
    }
    with tempfile.TemporaryDirectory() as folder:
        runs = {
            name: open_run(source, with_overrides(config, threads=1, samples=10**9), Path(folder) / name)
            for name, config in recipes.items()
        }
        with training_threads(TrainConfig(threads=1)):
            measured = measure_speed(runs, samples)
        first = measured[0]["samples_per_s"]
        for row in measured:
            export_policy(runs[row["recipe"]].learner.average, runs[row["recipe"]].spec, Path(folder) / "policy")
            row |= measure_latency(load_policy(Path(folder) / "policy"), source.images[:40])
            row["ratio"] = round(row["samples_per_s"] / first, 2)
    return measured


def open_run(source, config: TrainConfig, out: Path) -> TrainRun:
    """A training run that nothing was done for so far."""
    return TrainRun(build_parts(source, None, config), source.robot, source.sensor, config, out, data={})


def measure_speed(runs: dict[str, TrainRun], samples: int, rounds: int = 3) -> list[dict]:
    """Samples and frames per second of processor time, validation included, decoded frames in memory."""
    spent_s = dict.fromkeys(runs, 0.0)
    for run in runs.values():
        run.training.frames.get(run.training.table, np.arange(len(run.training.table)))
        run.step()
    begun = {name: run.samples_seen for name, run in runs.items()}
    for turn in range(rounds):
        for name, run in runs.items():
            begin_s = time.process_time()
            while run.samples_seen - begun[name] < samples * (turn + 1) / rounds:
                run.step()
            if turn == rounds - 1:
                run.validate()
            spent_s[name] += time.process_time() - begin_s
    return [
        {
            "recipe": name,
            "parameters": parameter_count(run.learner.model),
            "samples_per_s": round((run.samples_seen - begun[name]) / spent_s[name], 1),
            "frames_per_s": round((run.samples_seen - begun[name]) / spent_s[name] * frames_per_sample(run), 1),
        }
        for name, run in runs.items()
    ]


def frames_per_sample(run: TrainRun) -> float:
    """Distinct frames in a batch, per sample."""
    sampling, table, rng = run.config.sampling, run.training.table, np.random.default_rng(0)
    timing = timing_of(run.spec.robot, run.config)
    shape = {"batch_size": sampling.batch_size, "chain_length": sampling.chain_length}
    batches = [draw_samples(table, **shape, spacing_steps=timing.spacing_steps, rng=rng) for _ in range(20)]
    return sum(len(make_batch(rows, table.first, timing).frames) / len(rows) for rows in batches) / len(batches)


def measure_latency(policy: Policy, images: list) -> dict:
    """Milliseconds of thread CPU time per control step."""
    frames, goals = np.stack(images), np.array([[4.0, 1.0]], np.float32)
    previous, memory = np.zeros((1, 2), np.float32), policy.start()
    policy.step([memory], frames[:1], previous, goals)
    begin_s = time.thread_time()
    for frame in frames:
        policy.step([memory], frame[None], previous, goals)
    return {"step_ms": round((time.thread_time() - begin_s) / len(frames) * 1e3, 2)}


def measure_learning(config: TrainConfig, episodes: int, drives: int, out: Path) -> dict:
    """Open-loop errors and closed-loop successes in the toy rooms."""
    rooms = make_rooms(RobotConfig(), seed=ROOMS_SEED, boxes=BOXES)
    metrics = train_policy(record(rooms, episodes, seed=0), config, out)
    policy = load_policy(out)
    metrics.pop("history")
    successes = {
        "policy": count_successes(rooms, drives, lambda task: policy_command(policy)),
        "expert": count_successes(
            rooms, drives, lambda task: lambda i, g, p, pose: expert_command(task.cost, pose, rooms.robot)
        ),
        "straight-line": count_successes(
            rooms, drives, lambda task: lambda i, g, p, pose: straight_line_command(g, rooms.robot)
        ),
    }
    rates = {
        name: {
            "success_rate": round(count / drives, 3),
            "interval": [round(x, 3) for x in wilson_interval(count, drives)],
        }
        for name, count in successes.items()
    }
    return metrics | {"drives": drives, "static": rates}


def count_successes(rooms: Rooms, drives: int, make_command) -> int:
    """Successes of a method between new starts and goals, the same ones for every method."""
    rng = np.random.default_rng(99)
    count = 0
    for _ in range(drives):
        task: ToyTask = draw_task(rooms, rng)
        outcome, _ = drive(rooms, task, make_command(task))
        count += outcome == "success"
    return count


def policy_command(policy: Policy):
    """Commands of the policy in one episode."""
    memory = policy.start()

    def command(image, goal, previous, pose):
        previous_row, goal_row = np.array([previous], np.float32), np.array([goal], np.float32)
        v, w = policy.step([memory], image[None], previous_row, goal_row)[0].tolist()
        return (v, w) if math.isfinite(v) and math.isfinite(w) else (0.0, 0.0)

    return command


def main() -> None:
    """Measure and print one JSON line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("cost", "learn"))
    parser.add_argument("--samples", type=int, default=3000, help="of each recipe, to measure its cost")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--drives", type=int, default=100)
    parser.add_argument("--paper", action="store_true", help="Adam at a constant 1e-4")
    parser.add_argument("--out", type=Path, help="keep the policy in this folder")
    args = parser.parse_args()
    if args.what == "cost":
        result = measure_cost(args.samples)
    else:
        recipe = RECIPES["paper" if args.paper else "fast"]()
        config = with_overrides(recipe, minutes=args.minutes, threads=args.threads)
        with tempfile.TemporaryDirectory() as folder:
            result = measure_learning(config, args.episodes, args.drives, args.out or Path(folder))
    print(json.dumps(result))


if __name__ == "__main__":
    main()
