"""What the policy costs and learns.

    python -m readygo.benchmarks.policy.policy cost
    ... learn --minutes 10 --out FOLDER

cost: parameters, training samples per second, and milliseconds per control step of the exported policy (thread CPU
time, one thread).
learn: trains on an expert's episodes in toy rooms (`toy_rooms.py`), then drives in the same rooms between new starts
and goals, beside an expert and a straight line.
"""

import argparse
import json
import math
import os
import tempfile
import time
from pathlib import Path

import numpy as np

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from readygo.benchmarks.policy.toy_rooms import Rooms, Task, draw_task, drive, expert_command, make_rooms, record
from readygo.common.episode.metrics import wilson_interval
from readygo.common.episode.straight_line import straight_line_command
from readygo.common.policy import Policy, load_policy
from readygo.common.robot import RobotConfig
from readygo.services.trainer import TrainConfig, paper_recipe
from readygo.services.trainer.train import train

ROOMS_SEED, BOXES = 3, 28


def measure_cost(threads: int) -> dict:
    """Parameters, training speed and latency."""
    rooms = make_rooms(RobotConfig(), seed=ROOMS_SEED, boxes=BOXES)
    source = record(rooms, 6, seed=0)
    with tempfile.TemporaryDirectory() as folder:
        config = TrainConfig(epochs=2, threads=threads, validation_samples=50, validate_every_steps=10**6)
        cpu_s, wall_s = time.process_time(), time.monotonic()
        metrics = train(source, config, Path(folder))
        cpu_s, wall_s = time.process_time() - cpu_s, time.monotonic() - wall_s
        policy = load_policy(folder)
    return {
        "parameters": metrics["parameters"],
        "threads": threads,
        "train_samples_per_s": round(metrics["samples_per_s"], 1),
        "train_samples_per_cpu_s": round(metrics["samples_seen"] / cpu_s, 1),
        "train_wall_s": round(wall_s, 1),
        **measure_latency(policy, source.images[:40]),
    }


def measure_latency(policy: Policy, images: list) -> dict:
    """Milliseconds of thread CPU time per control step."""
    frames, goals = np.stack(images), np.array([[4.0, 1.0]], np.float32)
    previous = np.zeros((1, 2), np.float32)
    latent = policy.encode(frames[:1])
    begin_s = time.thread_time()
    policy.encode(frames)
    encode_ms = (time.thread_time() - begin_s) / len(frames) * 1e3
    begin_s = time.thread_time()
    for _ in range(200):
        policy.act(np.tile(latent, (1, 3)), previous, goals)
    head_ms = (time.thread_time() - begin_s) / 200 * 1e3
    return {"encode_ms": round(encode_ms, 2), "head_ms": round(head_ms, 3), "step_ms": round(encode_ms + head_ms, 2)}


def measure_learning(config: TrainConfig, episodes: int, drives: int, out: Path) -> dict:
    """Open-loop errors and closed-loop successes in the toy rooms."""
    rooms = make_rooms(RobotConfig(), seed=ROOMS_SEED, boxes=BOXES)
    metrics = train(record(rooms, episodes, seed=0), config, out)
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
        task: Task = draw_task(rooms, rng)
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
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--drives", type=int, default=100)
    parser.add_argument("--paper", action="store_true", help="Adam at a constant 1e-4")
    parser.add_argument("--out", type=Path, help="keep the policy in this folder")
    args = parser.parse_args()
    if args.what == "cost":
        result = measure_cost(args.threads or 1)
    else:
        config = TrainConfig(minutes=args.minutes, threads=args.threads)
        config = paper_recipe(config) if args.paper else config
        with tempfile.TemporaryDirectory() as folder:
            result = measure_learning(config, args.episodes, args.drives, args.out or Path(folder))
    print(json.dumps(result))


if __name__ == "__main__":
    main()
