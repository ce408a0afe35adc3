"""How well each expert can be imitated.

    python -m experiments.planning.imitation [MAP] [--episodes 150] [--modes ...]

A small network is fitted to the successful runs of each expert, from what a policy could at best make of its images:
the relative goal, the previous action, 32 rays to the nearest obstacles within the field of view and, with "people",
where the visible people are and how they move. Its error on episodes that it has not seen bounds the floor of behaviour
cloning from above: a larger network or more episodes may do better; what stays then follows from things out of view, or
from the expert's own state (its plan).

Errors of v and w are mean squared ones over the variance of the action: 1 is predicting the mean. "repeat" predicts
the previous action. "change" is the error in how the action changes until 0.5 s later over that of "repeat": the part
of the expert's decisions that stays unknown, 1 is all of it. It is what tells experts apart: actions change by little
per step, so that repeating the previous one has next to no error.
"""

import argparse
import itertools
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.benchmarks.planning.maps import default_data_folder, find_map
from readygo.benchmarks.planning.runs import Course, PlanningJob
from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.camera import CameraConfig
from readygo.common.camera.view import view_of
from readygo.common.frames import goal_in_robot_frame
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import OccupancyMap
from readygo.common.messages import (
    EpisodeMotions,
    Outcome,
    RobotPlanRequest,
    RobotTrajectory,
    Scenario,
    Split,
)
from readygo.runs.scenarios import accepted_scenarios
from readygo.services.planner import handle_robot_plan
from readygo.services.planner.expert.perception import in_view

RAYS = 32
RAY_M = 8.0
PEOPLE = 2
"""The nearest visible people that the network is told of."""
AHEAD = 10
"""Steps of 0.05 s over which changes of the action are predicted."""
EVERY = 4
"""Steps of 0.05 s between samples of a run."""
NEAR_M = 3.0
HIDDEN = 64
DROPOUT = 0.3
EPOCHS = 60
BATCH = 256
VALIDATION, HELD_OUT = 0.13, 0.25
"""Shares of the runs that end the training and that errors are measured on."""
MODES = ("paper", "spacetime", "near_field", "oracle")
FEATURES = ("no people", "people")


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Steps of some runs."""

    plain: Float64Array
    """Goal, previous action, rays, shape (N, 5 + RAYS)."""
    people: Float64Array
    """Presence, position [m] and velocity [m/s] of people in the robot's frame, shape (N, 5 * PEOPLE)."""
    actions: Float64Array
    """v [m/s] and w [rad/s] now and AHEAD steps later (or in the end), shape (N, 4)."""
    previous: Float64Array
    """The action before, shape (N, 2)."""
    near: BoolArray
    """True where a human is within NEAR_M, in view or not, shape (N,)."""
    run: Int64Array
    """Which run it is of, shape (N,)."""


@kernel_with_cache
def _free_m(
    occupied: BoolArray, origin_x: float, origin_y: float, cell: float, x: float, y: float, bearing: float
) -> float:
    """Distance to the first occupied cell on a ray, in half cells up to RAY_M [m]."""
    dx, dy = 0.5 * cell * math.cos(bearing), 0.5 * cell * math.sin(bearing)
    for k in range(int(RAY_M / (0.5 * cell))):
        i, j = math.floor((y + k * dy - origin_y) / cell), math.floor((x + k * dx - origin_x) / cell)
        if i < 0 or j < 0 or i >= occupied.shape[0] or j >= occupied.shape[1] or occupied[i, j]:
            return k * 0.5 * cell
    return RAY_M


class Eyes:
    """What a policy could at best see on a map."""

    def __init__(self, robot_map: OccupancyMap, camera: CameraConfig, human_radius_m: float) -> None:
        self._map, self._view, self._human_m = robot_map, view_of(camera), human_radius_m

    def free_m(self, pose: Sequence[float], bearing_rad: float) -> float:
        """Free way in a direction of the robot's frame [m]."""
        frame = self._map.frame
        place = frame.origin_x_m, frame.origin_y_m, frame.resolution_m
        return float(_free_m(self._map.occupied, *place, pose[0], pose[1], pose[2] + bearing_rad))

    def rays(self, pose: Sequence[float]) -> list[float]:
        """Free ways across the field of view, as shares of RAY_M."""
        bearings = np.linspace(-self._view.right_rad, self._view.left_rad, RAYS).tolist()
        return [self.free_m(pose, bearing) / RAY_M for bearing in bearings]

    def people(self, pose: Sequence[float], now_m: Float64Array, before_m: Float64Array) -> list[float]:
        """1, x, y, vx, vy of the nearest visible people in the robot's frame; zeros for those that are not there."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        seen = []
        for (x, y), (x0, y0) in zip(now_m.tolist(), before_m.tolist(), strict=True):
            forward, left = c * (x - pose[0]) + s * (y - pose[1]), c * (y - pose[1]) - s * (x - pose[0])
            away_m = math.hypot(forward, left)
            inside = in_view((pose[0], pose[1], pose[2]), x, y, self._view, RAY_M, self._human_m)
            if inside and self.free_m(pose, math.atan2(left, forward)) >= away_m - self._human_m:
                vx, vy = (x - x0) / 0.2, (y - y0) / 0.2
                seen.append((away_m, [1.0, forward, left, c * vx + s * vy, c * vy - s * vx]))
        rows = [row for _, row in sorted(seen)[:PEOPLE]]
        return [value for row in rows + [[0.0] * 5] * (PEOPLE - len(rows)) for value in row]


def samples_of(eyes: Eyes, runs: Sequence[tuple[Scenario, EpisodeMotions, RobotTrajectory]]) -> Samples:
    """Every EVERY-th step of some runs."""
    plain, people, actions, previous, near, owner = [], [], [], [], [], []
    for number, (scenario, motions, run) in enumerate(runs):
        roots = [human.motion.root_m[:, :2].astype(np.float64) for human in motions.humans]
        for step in range(0, len(run.actions), EVERY):
            pose = run.xyyaw[step].tolist()
            at = [np.array([root[min(k, len(root) - 1)] for root in roots]) for k in (step, max(step - 4, 0))]
            before = run.actions[step - 1] if step else np.zeros(2)
            goal = goal_in_robot_frame(*pose, scenario.goal_xy_m)
            away_m = math.hypot(*goal)
            ahead = [goal[0] / max(away_m, 1e-6), goal[1] / max(away_m, 1e-6), away_m / 10]
            plain.append([*ahead, *before.tolist(), *eyes.rays(pose)])
            people.append(eyes.people(pose, *at))
            actions.append([*run.actions[step], *run.actions[min(step + AHEAD, len(run.actions) - 1)]])
            previous.append(before)
            near.append(run.human_distance_m[step] < NEAR_M)
            owner.append(number)
    arrays = [np.array(rows, np.float64) for rows in (plain, people, actions, previous)]
    return Samples(
        plain=arrays[0],
        people=arrays[1],
        actions=arrays[2],
        previous=arrays[3],
        near=np.array(near),
        run=np.array(owner),
    )


def successful_runs(
    course: Course, mode: str, count: int
) -> tuple[list[tuple[Scenario, EpisodeMotions, RobotTrajectory]], int]:
    """The first `count` runs of an expert that succeed, as a dataset holds, and the number of those that failed."""
    runs: list[tuple[Scenario, EpisodeMotions, RobotTrajectory]] = []
    failed = 0
    drawn = accepted_scenarios(course.human_planner, course.animator, course.job.seed, Split.TRAIN, itertools.count())
    while len(runs) < count:
        scenario, motions = next(drawn)
        run = handle_robot_plan(
            course.robot_planners[mode], RobotPlanRequest(scenario=scenario, motions=motions)
        ).trajectory
        assert run is not None
        if run.outcome is Outcome.SUCCESS:
            runs.append((scenario, motions, run))
        else:
            failed += 1
    return runs, failed


def mirrored(inputs: Float64Array) -> Float64Array:
    """The inputs in the mirrored world, where left is right."""
    plain, people = inputs[:, : 5 + RAYS].copy(), inputs[:, 5 + RAYS :].copy()
    plain[:, [1, 4]] *= -1
    plain[:, 5:] = plain[:, :4:-1]
    for sideways in (2, 4):
        people[:, sideways::5] *= -1
    return np.hstack([plain, people])


def fitted(inputs: Float64Array, targets: Float64Array, part: npt.NDArray[np.int8], seed: int) -> Float64Array:
    """Predictions of a small network that knows the runs of part 0 and their mirror images, for all rows.

    Args:
        inputs: Features, shape (N, F).
        targets: Changes of v and w, and of these again later, shape (N, 4).
        part: 0 for rows to learn from, 1 for rows that choose the best epoch, 2 for others, shape (N,).
        seed: Seed of the network and of the order of the rows.
    """
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    mean, scale = inputs[part == 0].mean(axis=0), inputs[part == 0].std(axis=0)
    spread = targets[part == 0].std(axis=0)

    def tensor(rows: Float64Array) -> Any:
        return torch.tensor((rows - mean) / np.where(scale > 1e-6, scale, 1.0), dtype=torch.float32)

    x, y = tensor(inputs), torch.tensor(targets / spread, dtype=torch.float32)
    learn, check = (torch.tensor(np.flatnonzero(part == k)) for k in (0, 1))
    flip = torch.tensor([1.0, -1.0, 1.0, -1.0])
    known = torch.cat([x[learn], tensor(mirrored(inputs))[learn]])
    wanted = torch.cat([y[learn], y[learn] * flip])
    network = _network(torch, x.shape[1], y.shape[1])
    optimizer = torch.optim.AdamW(network.parameters(), lr=2e-3, weight_decay=3e-2)
    loss = torch.nn.functional.mse_loss
    best, predicted = math.inf, y
    for _ in range(EPOCHS):
        network.train()
        for batch in torch.split(torch.randperm(len(known)), BATCH):
            optimizer.zero_grad()
            loss(network(known[batch]), wanted[batch]).backward()
            optimizer.step()
        network.eval()
        with torch.no_grad():
            now = network(x)
            error = float(loss(now[check], y[check]))
        if error < best:
            best, predicted = error, now
    changes: Float64Array = predicted.numpy().astype(np.float64) * spread
    return changes


def _network(torch: Any, inputs: int, outputs: int) -> Any:
    nn = torch.nn
    first = [nn.Linear(inputs, HIDDEN), nn.ReLU(), nn.Dropout(DROPOUT)]
    second = [nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Dropout(DROPOUT)]
    return nn.Sequential(*first, *second, nn.Linear(HIDDEN, outputs))


def errors(samples: Samples, predicted: Float64Array, rows: BoolArray) -> dict[str, float]:
    """Errors over some rows: of the action over its variance, of its later change over that of repeating."""
    spread = samples.actions.var(axis=0)
    error = ((predicted - samples.actions)[rows] ** 2).mean(axis=0)
    repeat = ((_repeated(samples) - samples.actions)[rows] ** 2).mean(axis=0)
    nmse_v, nmse_w = (error[:2] / spread[:2]).tolist()
    change_v, change_w = (error[2:] / repeat[2:]).tolist()
    named = {"nmse_v": nmse_v, "nmse_w": nmse_w, "change_v": change_v, "change_w": change_w}
    return {name: round(value, 4) for name, value in named.items()}


def _repeated(samples: Samples) -> Float64Array:
    return np.hstack([samples.previous, samples.previous])


def study(course: Course, mode: str, episodes: int) -> dict[str, Any]:
    """Fit the networks of one expert."""
    runs, failed = successful_runs(course, mode, episodes)
    eyes = Eyes(course.maps.robot, course.robot.camera, course.episode.human_radius_m)
    samples = samples_of(eyes, runs)
    share = samples.run / episodes
    part = np.where(share >= 1 - HELD_OUT, 2, np.where(share >= 1 - HELD_OUT - VALIDATION, 1, 0)).astype(np.int8)
    result: dict[str, Any] = {
        "mode": mode,
        "episodes": episodes,
        "failed": failed,
        "samples": len(samples.actions),
        "near_share": round(float(samples.near.mean()), 3),
    }
    repeated = _repeated(samples)
    predictions = {"repeat": repeated}
    for name in FEATURES:
        inputs = samples.plain if name == "no people" else np.hstack([samples.plain, samples.people])
        predictions[name] = repeated + fitted(inputs, samples.actions - repeated, part, seed=0)
    for name, predicted in predictions.items():
        near = (part == 2) & samples.near
        result[name] = {"all": errors(samples, predicted, part == 2), "near": errors(samples, predicted, near)}
    return result


def text(results: Sequence[dict[str, Any]]) -> str:
    """The results for people."""
    head = f"{'expert':<12}{'features':<11}{'v':>8}{'w':>8}{'change v':>10}{'change w':>10}"
    lines = [f"{'':<23}{'all held-out samples':>36}{f'a human within {NEAR_M:g} m':>36}", head + head[23:]]
    for result in results:
        for name in ("repeat", *FEATURES):
            cells = [
                f"{row['nmse_v']:>8.3f}{row['nmse_w']:>8.3f}{row['change_v']:>10.2f}{row['change_w']:>10.2f}"
                for row in (result[name]["all"], result[name]["near"])
            ]
            lines.append(f"{result['mode'] if name == 'repeat' else '':<12}{name:<11}{''.join(cells)}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("map", nargs="?", default="embedded", help="as in `readygo bench plan --maps`")
    parser.add_argument("--episodes", type=int, default=150, help="successful ones per expert")
    parser.add_argument("--modes", nargs="+", choices=MODES, default=MODES)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="one JSON object per expert instead of a table")
    arguments = parser.parse_args()
    source = find_map(arguments.map, default_data_folder())
    course = Course(PlanningJob(source=source, modes=tuple(arguments.modes), tasks=("dynamic",), seed=arguments.seed))
    results = []
    for mode in arguments.modes:
        begin_s = time.process_time()
        results.append(study(course, mode, arguments.episodes) | {"map": source.name})
        results[-1]["cpu_s"] = round(time.process_time() - begin_s, 1)
        sys.stderr.write(f"{mode}: {results[-1]['cpu_s']} s\n")
    sys.stdout.write("".join(json.dumps(row) + "\n" for row in results) if arguments.json else text(results))


if __name__ == "__main__":
    main()
