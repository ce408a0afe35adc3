"""Hybrid A* in space and time: the robot's ground is free of a human when the human is not there yet, or gone.

Nodes keep pose, command and time; one node per place, heading, speed and half second survives. Waiting and turning in
place are primitives like any other. Sources: Dolgov et al., IJRR 29 (2010), for the search over poses; Silver,
Cooperative pathfinding, AIIDE 2005, for reserving cells in time.

Legend: places (x, y) [m] count from the map's corner; (i, j) is the row and column of a cell. A primitive q has K rows
of x, y, yaw relative to its start, v, w, one per step; depth counts primitives from the start, so that a node's time is
depth * K steps. A group is the primitives that may follow a command, speed level * turn levels + turn level. Costs are
metres at full speed: f = g + weight * h with

    g = sum over primitives of (own cost + what walls and humans add),
    h = way to the goal + what turning towards it costs + delay by humans.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array, UInt8Array
from readygo.common.episode.grid_search import UNITS_PER_CELL, UNREACHED
from readygo.common.kernels import kernel_with_cache
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.config import PRIMITIVE_S, REVERSE_COST
from readygo.services.planner.expert.delay import LAYER_S, Delays, delay_at, fill_delays
from readygo.services.planner.expert.primitive_cost import check_reaches, find_near, human_cost, wall_cost
from readygo.services.planner.expert.records import CostGrid, Goal, HumansAhead, Obstacles, State
from readygo.services.planner.expert.rollouts import TRACKING_MARGIN_M
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
from readygo.services.planner.expert.timed_primitives import PrimitiveTable, make_timed_primitives

_HEURISTIC_WEIGHT = 1.2
"""1.0 searches for the cheapest plan, more is faster."""
_HEADING_COUNT = 36
"""Headings that are told apart in a cell, at least: 10 degrees each."""
_EXPANSIONS_MAX = 1000
"""Expansions after which a search takes the best plan so far."""
_DEPTH, _GROUP = 2, 3
"""Places in a node's links, after parent and primitive."""
_TABLE_SIZE = 1 << 16
_KEY_CELL_M = 0.1
"""Side of the places of which one node each survives [m]."""
_DEPTHS = 64
"""More than the primitives of the longest plan."""
_SLOPE_CELLS = 3
"""Cells on each side over which the direction to the goal is taken."""
_DRIVEN_TURN_RAD, _DRIVEN_TURN_S = 0.6, 1.5
"""Driving on mends a heading that is away from the way by so much, and no more than the robot turns in so long."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TimedPlan:
    """Commands for the next seconds, and where they lead."""

    rows: Float64Array
    """x [m], y [m], yaw [rad], v [m/s], w [rad/s] after 0, 1, 2, ... steps, shape (N, 5)."""
    cost: float
    """Cost of the rows, in metres at full speed, and of the way that is left after them."""


class TimedSearchRules(NamedTuple):
    """Settings of a search."""

    radius_m: float
    """What plans keep free around the robot's centre [m]."""
    turn_cost_m: float
    """What turning in place by one radian is expected to cost [m]."""
    driven_turn_rad: float
    """By how much a heading may be away from the way at no cost [rad]."""
    reverse_cost: float
    """What a metre backwards costs more than one forwards; infinite for a robot that does not reverse."""
    turn_level_count: int
    heading_count: int
    depth_max: int
    """Primitives of the longest plan."""


class SpaceTimeSearch:
    """Keeps its working memory between searches, so it is not thread-safe."""

    def __init__(self, robot: RobotConfig, *, horizon_s: float, goal_tolerance_m: float) -> None:
        """Prepare for a robot.

        Args:
            robot: Footprint and limits.
            horizon_s: Longest time that plans reach ahead, in whole primitives of about `PRIMITIVE_S` [s].
            goal_tolerance_m: A plan that comes this near to the goal need not last longer [m].
        """
        self._primitives = make_timed_primitives(robot)
        # A primitive is whole held commands, and so may last longer than PRIMITIVE_S.
        longest = math.floor(horizon_s / (self._primitives.steps * robot.clock.dt_s) + 1e-9)
        self._memory = SearchMemory(_EXPANSIONS_MAX * 16 + 64, _GROUP + 1, _TABLE_SIZE)
        self._rules = TimedSearchRules(
            radius_m=robot.radius_m + TRACKING_MARGIN_M,
            # What a turn in place costs by its time; the way to the goal knows nothing of headings.
            turn_cost_m=0.5 * robot.v_max_mps / robot.w_max_radps,
            driven_turn_rad=min(_DRIVEN_TURN_RAD, _DRIVEN_TURN_S * robot.w_max_radps),
            reverse_cost=REVERSE_COST if robot.reverses else math.inf,
            turn_level_count=self._primitives.turn_level_count,
            # A primitive that turns by less than a heading would be hidden by the straight one, which is cheaper.
            heading_count=max(_HEADING_COUNT, math.ceil(2 * math.pi / (robot.w_max_radps * PRIMITIVE_S))),
            depth_max=min(longest, round(horizon_s / PRIMITIVE_S)),
        )
        layer_steps = robot.clock.steps(LAYER_S)
        layers = self._rules.depth_max * self._primitives.steps // layer_steps + 1
        self._delays = Delays(
            cell_m=robot.v_max_mps * layer_steps * robot.clock.dt_s,
            speed_mps=robot.v_max_mps,
            arrived_m=goal_tolerance_m,
            static_m=np.empty((2 * layers + 3, 2 * layers + 3)),
            values_m=np.zeros((layers, 2 * layers + 3, 2 * layers + 3)),
            layer_steps=layer_steps,
        )
        self.expansion_count = 0
        """Expansions of the latest search."""

    def search(
        self,
        factor: UInt8Array,
        heuristic: Int32Array,
        obstacles: Obstacles,
        state: State,
        goal_xy_m: tuple[float, float],
        humans: HumansAhead,
    ) -> TimedPlan | None:
        """Search commands that lead to the goal, or as far as humans are predicted.

        Args:
            factor: Cost factors of the cells (see `readygo.common.episode.grid_search`), shape (H, W).
            heuristic: Distances to the goal on the same grid, UNITS_PER_CELL a cell, shape (H, W).
            obstacles: The map that the cells belong to.
            state: The robot.
            goal_xy_m: Goal in the world [m].
            humans: Who is in the way.

        Returns:
            A plan, or None if there is not even a first step.
        """
        ox, oy, resolution = obstacles.origin_x_m, obstacles.origin_y_m, obstacles.resolution_m
        self._primitives.fill_root(state[3], state[4])
        # The compiled search counts from the corner of the map.
        start = (state[0] - ox, state[1] - oy, state[2])
        seen = humans.seen_from(ox, oy)
        grid = CostGrid(factor, heuristic, resolution)
        if len(humans.expected_m) > 0:
            fill_delays(grid, start, seen, self._delays)
        memory = self._memory.begin()
        found, self.expansion_count = _search(
            grid,
            obstacles._replace(origin_x_m=0.0, origin_y_m=0.0),
            start,
            Goal(goal_xy_m[0] - ox, goal_xy_m[1] - oy, self._delays.arrived_m),
            self._primitives.table,
            (seen, self._delays),
            self._rules,
            memory,
        )
        if found <= 0:
            return None
        rows = np.empty((int(memory.links[found, _DEPTH]) * self._primitives.steps + 1, 5))
        rows[0] = state
        _trace(found, memory, self._primitives.table.rows, (ox, oy), rows)
        x, y = float(memory.nodes[found, X]), float(memory.nodes[found, Y])
        left = float(heuristic[int(y / resolution), int(x / resolution)]) * resolution / UNITS_PER_CELL
        return TimedPlan(rows=rows, cost=float(memory.nodes[found, COST]) + left)


@kernel_with_cache
def _key(x: float, y: float, yaw: float, counts: tuple[int, int, int], depth: int, speed: int) -> int:
    """What nodes share of which one survives; `counts` are columns, headings, and more than there are speeds."""
    # Mixed radix: row, column, heading, depth, speed.
    columns, heading_count, speed_count = counts
    heading = int(yaw * (heading_count / (2 * math.pi)))
    if heading >= heading_count:
        heading -= heading_count
    key = int(y / _KEY_CELL_M) * columns + int(x / _KEY_CELL_M)
    return ((key * heading_count + heading) * _DEPTHS + depth) * speed_count + speed


@kernel_with_cache
def _wrap_yaw(yaw: float) -> float:
    """An angle between -2 pi and 4 pi as one between 0 and 2 pi; a modulo is slow."""
    if yaw < 0.0:
        return yaw + 2 * math.pi
    return yaw - 2 * math.pi if yaw >= 2 * math.pi else yaw


@kernel_with_cache
def _turn_left(heuristic: Int32Array, i: int, j: int, yaw: float, driven_rad: float) -> float:
    """By how much a heading is away from the way to the goal, beyond what driving on can mend [rad]."""
    # Central differences of the distances point down to the goal.
    reach = _SLOPE_CELLS
    if i < reach or j < reach or i + reach >= heuristic.shape[0] or j + reach >= heuristic.shape[1]:
        return 0.0
    west, east = heuristic[i, j - reach], heuristic[i, j + reach]
    south, north = heuristic[i - reach, j], heuristic[i + reach, j]
    dx, dy = west - east, south - north
    if max(west, east, south, north) >= UNREACHED:
        # Beside walls there is no slope across: the best way out counts.
        best = heuristic[i, j]
        dx, dy = 0, 0
        for a in range(-1, 2):
            for b in range(-1, 2):
                near = heuristic[i + a * reach, j + b * reach]
                if near < best:
                    best, dx, dy = near, b, a
        if dx == 0 and dy == 0:
            return 0.0
    # The difference of both directions, in -pi .. pi.
    away = (math.atan2(dy, dx) - yaw + math.pi) % (2 * math.pi) - math.pi
    return max(0.0, abs(away) - driven_rad)


@kernel_with_cache
def _search(
    grid: CostGrid,
    obstacles: Obstacles,
    start: tuple[float, float, float],
    goal: Goal,
    primitives: PrimitiveTable,
    traffic: tuple[HumansAhead, Delays],
    rules: TimedSearchRules,
    memory: Memory,
) -> tuple[int, int]:
    """Last node of the plan or -1, and the number of expansions.

    Links are parent, primitive, depth, and the group of primitives that may follow. `traffic` is who is in the way, and
    how long that holds the robot up.
    """
    factor, heuristic, resolution = grid
    rows, costs, lengths, ends, first = primitives
    nodes, links, heap_cost, heap_node, table_key, table_node, table_stamp, stamp = memory
    radius, turn_cost, driven_turn, reverse_cost, turn_levels, heading_count, depth_max = rules
    humans, delays = traffic
    expected = humans.expected_m
    steps = rows.shape[1]
    metres = resolution / UNITS_PER_CELL
    columns = int(factor.shape[1] * resolution / _KEY_CELL_M) + 2
    speeds, counts = ends // turn_levels, (columns, heading_count, len(first))
    nodes[0, X], nodes[0, Y], nodes[0, YAW], nodes[0, COST] = start[0], start[1], start[2] % (2 * math.pi), 0.0
    # The last group is that of the robot's present command.
    links[0, PARENT], links[0, PRIMITIVE], links[0, _DEPTH], links[0, _GROUP] = -1, -1, 0, len(first) - 2
    waiting = push(heap_cost, heap_node, 0, 0.0, 0)
    count, expansions = 1, 0
    reaches = check_reaches(rows)
    near, near_counts = np.empty((len(reaches), len(expected)), np.int32), np.zeros(len(reaches), np.int32)
    best, best_depth, best_left = -1, 0, np.inf
    while waiting > 0 and expansions < _EXPANSIONS_MAX:
        node = heap_node[0]
        waiting = pop(heap_cost, heap_node, waiting)
        x, y, yaw, cost = nodes[node, X], nodes[node, Y], nodes[node, YAW], nodes[node, COST]
        depth, group = links[node, _DEPTH], links[node, _GROUP]
        if node > 0:
            # A better node of this key came after it: this one is stale.
            key = _key(x, y, yaw, counts, depth, group // turn_levels)
            if table_node[slot_of(key, stamp, table_key, table_stamp)] != node:
                continue
            if depth >= depth_max or (x - goal[0]) ** 2 + (y - goal[1]) ** 2 < goal[2] * goal[2]:
                return node, expansions
            # The plan, should the search end early: the deepest node, of those the nearest to the goal.
            left = heuristic[int(y / resolution), int(x / resolution)] * metres
            if depth > best_depth or (depth == best_depth and left < best_left):
                best, best_depth, best_left = node, depth, left
        expansions += 1
        find_near(humans, (x, y), depth * steps, reaches, near, near_counts)
        c, s = math.cos(yaw), math.sin(yaw)
        for q in range(first[group], first[group + 1]):
            # Where the primitive ends: its last row, turned by the node's heading.
            end = rows[q, steps - 1]
            xx, yy = x + c * end[0] - s * end[1], y + s * end[0] + c * end[1]
            if xx < 0.0 or yy < 0.0:
                continue
            i, j = int(yy / resolution), int(xx / resolution)
            if i >= factor.shape[0] or j >= factor.shape[1] or heuristic[i, j] >= UNREACHED:
                continue
            new_yaw = _wrap_yaw(yaw + end[2])
            key = _key(xx, yy, new_yaw, counts, depth + 1, speeds[q])
            slot = slot_of(key, stamp, table_key, table_stamp)
            known = table_stamp[slot] == stamp
            new_cost = cost + costs[q]
            # Asked again after each part of the cost: the later ones take longer to compute.
            if known and nodes[table_node[slot], COST] <= new_cost:
                continue
            delay = 0.0
            if len(expected) > 0:
                delay = delay_at(delays, start, xx, yy, (depth + 1) * steps // delays.layer_steps)
                if delay == np.inf:
                    continue
            extra = wall_cost(factor, obstacles, radius, (x, y), (c, s), rows[q], lengths[q])
            if extra < 0.0 or (known and nodes[table_node[slot], COST] <= new_cost + extra):
                continue
            extra += human_cost((x, y), (c, s), rows[q], humans, depth * steps, near, near_counts)
            new_cost += extra
            if known and nodes[table_node[slot], COST] <= new_cost:
                continue
            # h: a robot that reverses may also turn its back to the goal, and pay for each metre.
            way = heuristic[i, j] * metres
            turn = turn_cost * _turn_left(heuristic, i, j, new_yaw, driven_turn)
            if reverse_cost < np.inf:
                backwards = turn_cost * _turn_left(heuristic, i, j, new_yaw + math.pi, driven_turn)
                turn = min(turn, backwards + reverse_cost * way)
            left = way + turn + delay
            if count >= len(nodes):
                return best, expansions
            nodes[count, X], nodes[count, Y], nodes[count, YAW], nodes[count, COST] = xx, yy, new_yaw, new_cost
            links[count, PARENT], links[count, PRIMITIVE], links[count, _DEPTH], links[count, _GROUP] = (
                node,
                q,
                depth + 1,
                ends[q],
            )
            table_stamp[slot], table_key[slot], table_node[slot] = stamp, key, count
            waiting = push(heap_cost, heap_node, waiting, new_cost + _HEURISTIC_WEIGHT * left, count)
            count += 1
    return best, expansions


@kernel_with_cache
def _trace(
    node: int, memory: Memory, primitives: Float64Array, origin: tuple[float, float], rows: Float64Array
) -> None:
    """Fill `rows`, the first of which is there, with the primitives that lead to a node."""
    nodes, links, _, _, _, _, _, _ = memory
    steps = primitives.shape[1]
    while links[node, PARENT] >= 0:
        parent, q = links[node, PARENT], links[node, PRIMITIVE]
        c, s = math.cos(nodes[parent, YAW]), math.sin(nodes[parent, YAW])
        at = links[parent, _DEPTH] * steps + 1
        for k in range(steps):
            ahead, left = primitives[q, k, 0], primitives[q, k, 1]
            rows[at + k, 0] = nodes[parent, X] + c * ahead - s * left + origin[0]
            rows[at + k, 1] = nodes[parent, Y] + s * ahead + c * left + origin[1]
            rows[at + k, 2] = nodes[parent, YAW] + primitives[q, k, 2]
            rows[at + k, 3], rows[at + k, 4] = primitives[q, k, 3], primitives[q, k, 4]
        node = parent
