"""Hybrid A*: a search over robot poses with motion primitives, on a grid of cost factors.

A node keeps its continuous pose; one node per cell and heading survives. Sources: Dolgov et al., Path planning for
autonomous vehicles in unknown semi-structured environments, IJRR 29 (2010); primitives and cost after the ReaDy-Go
paper: three speeds by three turn rates, arc length plus a steering penalty.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array, Int64Array, UInt8Array
from readygo.common.episode.grid_search import FREE, UNITS_PER_CELL, UNREACHED
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import GridFrame
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.config import GEAR_COST_M, GOAL_TOLERANCE_M, PRIMITIVE_S, REVERSE_COST
from readygo.services.planner.expert.records import CostGrid, Goal
from readygo.services.planner.expert.search_memory import (
    COST,
    PARENT,
    PRIMITIVE,
    YAW,
    Memory,
    SearchMemory,
    X,
    Y,
    pop,
    push,
    slot_of,
)

STEERING_COST = 0.2
"""Cost of full turning, per metre at full speed (the penalty is the paper's, its weight ours)."""
SLOW_COST = 0.2
"""Cost of standing still, per metre at full speed; 0 is the paper's cost, which dawdles."""
TURN_COST_M = 0.8
"""Cost of turning in place by one radian, which only a standing robot may do [m]."""
_HEURISTIC_WEIGHT = 1.5
"""1.0 searches for the cheapest path, more is faster."""
_HEADING_COUNT = 72
"""Headings that are told apart in a cell: 5 degrees each."""
_EXPANSIONS_MAX = 10_000
"""Expansions after which a search gives up."""
_SAMPLE_M = 0.05
_TURN_MIN_RAD = 0.35
"""A primitive lasts until the robot has turned this far: one that turns less ends among the cells and headings of the
straight one, which is cheaper and stands for both, so that robots with wide turns would never come round."""
_TABLE_SIZE = 1 << 19
_ROOT_COUNT = 24


class Primitives(NamedTuple):
    """Motion primitives, sampled every 5 cm."""

    offsets: Float64Array
    """Poses x [m], y [m], yaw [rad] relative to the primitive's start, shape (P, K, 3)."""
    sample_counts: Int64Array
    """Samples that each primitive uses, shape (P,)."""
    costs: Float64Array
    """Cost on free ground [m], shape (P,)."""
    speeds_mps: Float64Array
    """Speed of each primitive [m/s], shape (P,)."""


def make_primitives(robot: RobotConfig) -> Primitives:
    """Three speeds by left, straight and right, each for `PRIMITIVE_S`, or longer where turns are wide.

    A robot that reverses has two speeds backwards besides.
    """
    v_max, w_max = robot.v_max_mps, robot.w_max_radps
    duration_s = max(PRIMITIVE_S, _TURN_MIN_RAD / w_max)
    speeds = [v_max * k / 3 for k in (3, 2, 1)] + [robot.v_min_mps * k / 2 for k in (2, 1) if robot.reverses]
    commands = [(v, w_max * side) for v in speeds for side in (0, -1, 1)]
    counts = [math.ceil(abs(v) * duration_s / _SAMPLE_M - 1e-9) for v, _ in commands]
    offsets = np.zeros((len(commands), max(counts), 3))
    costs = []
    for p, (v, w) in enumerate(commands):
        for k in range(counts[p]):
            t = duration_s * (k + 1) / counts[p]
            arc = (v * t, 0.0) if w == 0 else (v / w * math.sin(w * t), v / w * (1 - math.cos(w * t)))
            offsets[p, k] = (*arc, w * t)
        turning = STEERING_COST * abs(w) / w_max * abs(v)
        slowness = SLOW_COST * (1 - abs(v) / v_max) * v_max
        backwards = REVERSE_COST * max(-v, 0.0)
        costs.append((abs(v) + turning + slowness + backwards) * duration_s)
    return Primitives(
        offsets=offsets,
        sample_counts=np.array(counts),
        costs=np.array(costs),
        speeds_mps=np.array([v for v, _ in commands]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A path to the goal."""

    xyyaw: Float64Array
    """Poses about every 5 cm, the start included: x [m], y [m] in the world, yaw [rad], shape (N, 3)."""
    speed_mps: Float64Array
    """Speed of the primitive that leads to each pose, negative backwards, shape (N,)."""
    cost: float
    expansion_count: int


class HybridAStar:
    """Keeps its working memory between searches, so it is not thread-safe."""

    def __init__(self, robot: RobotConfig) -> None:
        self._primitives = make_primitives(robot)
        self._memory = SearchMemory(_EXPANSIONS_MAX * 4 + 16, 2, _TABLE_SIZE)
        self._points = np.empty((4096, 4))
        self.expansion_count = 0
        """Expansions of the latest search."""

    def search(
        self,
        factor: UInt8Array,
        heuristic: Int32Array,
        frame: GridFrame,
        start_xyyaw: tuple[float, float, float],
        goal_xy_m: Float64Array,
        *,
        turn_first: bool = False,
    ) -> Plan | None:
        """Search a path.

        Args:
            factor: Cost factors of the cells (see `readygo.common.episode.grid_search`), shape (H, W).
            heuristic: Distances to the goal on the same grid, UNITS_PER_CELL a cell, shape (H, W).
            frame: Where the cells lie.
            start_xyyaw: Pose in the world [m, m, rad]; its own cell may be blocked.
            goal_xy_m: Goal in the world, shape (2,).
            turn_first: True lets the path begin with any heading, at the price of turning there in place.

        Returns:
            A plan, or None if there is none within the limit of expansions.
        """
        primitives = self._primitives
        ox, oy = frame.origin_x_m, frame.origin_y_m
        memory = self._memory.begin()
        last, self.expansion_count = _search(
            CostGrid(factor, heuristic, frame.resolution_m),
            (start_xyyaw[0] - ox, start_xyyaw[1] - oy, start_xyyaw[2]),
            Goal(float(goal_xy_m[0]) - ox, float(goal_xy_m[1]) - oy, GOAL_TOLERANCE_M),
            primitives,
            _ROOT_COUNT if turn_first else 1,
            memory,
        )
        if last < 0:
            return None
        count = _trace(last, memory, primitives, self._points)
        rows = self._points[len(self._points) - count :]
        xyyaw = rows[:, :3].copy()
        xyyaw[:, 0] += ox
        xyyaw[:, 1] += oy
        return Plan(
            xyyaw=xyyaw,
            speed_mps=rows[:, 3].copy(),
            cost=float(memory.nodes[last, COST]),
            expansion_count=self.expansion_count,
        )


@kernel_with_cache
def _drive_cost(
    factor: UInt8Array, resolution: float, x: float, y: float, c: float, s: float, offsets: Float64Array, count: int
) -> float:
    """Mean cost factor along a primitive (1 on free ground), negative if it is blocked."""
    height, width = factor.shape
    total = 0
    for k in range(count):
        px = x + c * offsets[k, 0] - s * offsets[k, 1]
        py = y + s * offsets[k, 0] + c * offsets[k, 1]
        if px < 0.0 or py < 0.0:
            return -1.0
        i, j = int(py / resolution), int(px / resolution)
        if i >= height or j >= width or factor[i, j] == 0:
            return -1.0
        total += factor[i, j]
    return total / (FREE * count)


@kernel_with_cache
def _search(
    grid: CostGrid,
    start: tuple[float, float, float],
    goal: Goal,
    primitives: Primitives,
    root_count: int,
    memory: Memory,
) -> tuple[int, int]:
    """Last node or -1, and the number of expansions.

    Places count from the corner of the grid; the search begins with `root_count` headings. f = g + weight * h: g is the
    sum of the primitives' costs, each times the mean cost factor of its cells, and h the way to the goal on the grid. A
    key is the cell and the heading.
    """
    factor, heuristic, resolution = grid
    offsets, sample_counts, costs, speeds = primitives
    nodes, links, heap_cost, heap_node, table_key, table_node, table_stamp, stamp = memory
    width = factor.shape[1]
    metres = _HEURISTIC_WEIGHT * resolution / UNITS_PER_CELL
    per_rad = _HEADING_COUNT / (2 * math.pi)
    count, waiting, expansions = 0, 0, 0
    for k in range(root_count):
        # Turning in place comes before the drive, either way round.
        turn = k * 2 * math.pi / root_count
        cost = TURN_COST_M * min(turn, 2 * math.pi - turn)
        nodes[k, X], nodes[k, Y], nodes[k, YAW], nodes[k, COST] = (
            start[0],
            start[1],
            (start[2] + turn) % (2 * math.pi),
            cost,
        )
        links[k, PARENT], links[k, PRIMITIVE] = -1, -1
        waiting = push(heap_cost, heap_node, waiting, cost, k)
        count += 1
    while waiting > 0 and expansions < _EXPANSIONS_MAX:
        node = heap_node[0]
        waiting = pop(heap_cost, heap_node, waiting)
        x, y, yaw, cost = nodes[node, X], nodes[node, Y], nodes[node, YAW], nodes[node, COST]
        if node >= root_count:
            # A better node of this key came after it: this one is stale.
            cell = int(y / resolution) * width + int(x / resolution)
            key = cell * _HEADING_COUNT + int(yaw * per_rad) % _HEADING_COUNT
            if table_node[slot_of(key, stamp, table_key, table_stamp)] != node:
                continue
        if (x - goal[0]) ** 2 + (y - goal[1]) ** 2 < goal[2] * goal[2]:
            return node, expansions
        expansions += 1
        c, s = math.cos(yaw), math.sin(yaw)
        for p in range(len(costs)):
            samples = sample_counts[p]
            mean_factor = _drive_cost(factor, resolution, x, y, c, s, offsets[p], samples)
            if mean_factor < 0:
                continue
            # Where the primitive ends: its last offset, turned by the node's heading.
            end = offsets[p, samples - 1]
            xx, yy = x + c * end[0] - s * end[1], y + s * end[0] + c * end[1]
            i, j = int(yy / resolution), int(xx / resolution)
            if heuristic[i, j] >= UNREACHED:
                continue
            new_yaw = (yaw + end[2]) % (2 * math.pi)
            new_cost = cost + costs[p] * mean_factor
            # A change of gear.
            if links[node, PARENT] >= 0 and speeds[p] * speeds[links[node, PRIMITIVE]] < 0:
                new_cost += GEAR_COST_M
            key = (i * width + j) * _HEADING_COUNT + int(new_yaw * per_rad) % _HEADING_COUNT
            slot = slot_of(key, stamp, table_key, table_stamp)
            if table_stamp[slot] == stamp and nodes[table_node[slot], COST] <= new_cost:
                continue
            if count >= len(nodes):
                return -1, expansions
            nodes[count, X], nodes[count, Y], nodes[count, YAW], nodes[count, COST] = xx, yy, new_yaw, new_cost
            links[count, PARENT], links[count, PRIMITIVE] = node, p
            table_stamp[slot], table_key[slot], table_node[slot] = stamp, key, count
            waiting = push(heap_cost, heap_node, waiting, new_cost + metres * heuristic[i, j], count)
            count += 1
    return -1, expansions


@kernel_with_cache
def _trace(node: int, memory: Memory, primitives: Primitives, points: Float64Array) -> int:
    """Fill the end of `points` with x, y, yaw, speed from start to `node`; returns their number."""
    nodes, links, _, _, _, _, _, _ = memory
    offsets, sample_counts, _, speeds = primitives
    at = len(points)
    while links[node, PARENT] >= 0 and at > offsets.shape[1]:
        parent, p = links[node, PARENT], links[node, PRIMITIVE]
        c, s = math.cos(nodes[parent, YAW]), math.sin(nodes[parent, YAW])
        for k in range(sample_counts[p] - 1, -1, -1):
            at -= 1
            points[at, 0] = nodes[parent, X] + c * offsets[p, k, 0] - s * offsets[p, k, 1]
            points[at, 1] = nodes[parent, Y] + s * offsets[p, k, 0] + c * offsets[p, k, 1]
            points[at, 2] = nodes[parent, YAW] + offsets[p, k, 2]
            points[at, 3] = speeds[p]
        node = parent
    at -= 1
    points[at, 0], points[at, 1], points[at, 2] = nodes[node, X], nodes[node, Y], nodes[node, YAW]
    points[at, 3] = points[at + 1, 3] if at + 1 < len(points) else 0.0
    return len(points) - at
