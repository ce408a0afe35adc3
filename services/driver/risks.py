"""What would become of the robot under each command of the grid: a collision with an obstacle, with a human, or none.

The robot obeys a command for `HOLD_S`, then brakes, within its limits; humans walk as they will. An expert says which
one command is right, and says as little of one that is a little worse as of one that ends in a wall; this tells them
apart. Humans' true ways are used: what a policy learns from many such samples is how likely a collision is as far as it
can see.

Source: rolled-out candidates as in Fox, Burgard and Thrun, The dynamic window approach to collision avoidance, 1997;
learned outcomes of actions as in Kahn et al., Self-supervised deep reinforcement learning with generalized computation
graphs, 2018.
"""

import math

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.collision import disc_meets_cells
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import OccupancyMap
from readygo.common.maps.distance import clearance_m
from readygo.common.robot.command_grid import HUMAN, OBSTACLE, command_grid

HOLD_S = 1.0
"""How long a command is obeyed [s]."""
HORIZON_S = 1.8
"""How far ahead collisions count [s]."""
OBSTACLE_MARGIN_M = 0.02
"""Added to the robot's radius towards obstacles [m]."""
HUMAN_MARGIN_M = 0.10
"""Added to the distance at which robot and human meet [m]."""
_STEP_S = 0.1
"""Length of a step of a rollout, as near as simulation steps come to it [s]."""


class RiskMap:
    """Rolls out commands in one scene."""

    def __init__(self, robot_map: OccupancyMap) -> None:
        """Prepare the map's clearance.

        Args:
            robot_map: What the robot collides with, not inflated.
        """
        frame = robot_map.frame
        self._occupied, self._clearance = robot_map.occupied, clearance_m(robot_map)
        self._frame = (frame.origin_x_m, frame.origin_y_m, frame.resolution_m)

    def risks(self, simulation: EpisodeSimulation) -> bytes:
        """Risks of all commands at the simulation's present state.

        Returns:
            `OBSTACLE`, `HUMAN` or 0 for every command of `command_grid`, one byte each.
        """
        robot = simulation.robot
        stride = max(simulation.clock.steps(_STEP_S), 1)
        dt_s = simulation.clock.dt_s * stride
        count = round(HORIZON_S / dt_s)
        steps = range(simulation.step + stride, simulation.step + stride * (count + 1), stride)
        humans_m = np.stack([simulation.human_xy_at(step) for step in steps])
        state = (simulation.x_m, simulation.y_m, simulation.yaw_rad, simulation.v_mps, simulation.w_radps)
        limits = (robot.v_max_mps, robot.w_max_radps, robot.a_max_mps2, robot.alpha_max_radps2, robot.v_min_mps, dt_s)
        grid = command_grid(robot)
        radii = (robot.radius_m, robot.radius_m + simulation.config.human_radius_m + HUMAN_MARGIN_M)
        out = np.zeros(len(grid), dtype=np.uint8)
        _roll_out(grid, state, limits, radii, self._occupied, self._clearance, self._frame, humans_m, out)
        return out.tobytes()


@kernel_with_cache
def _roll_out(
    grid: Float64Array,
    start: tuple[float, float, float, float, float],
    limits: tuple[float, float, float, float, float, float],
    radii: tuple[float, float],
    occupied: BoolArray,
    clearance: Float32Array,
    frame: tuple[float, float, float],
    humans: Float64Array,
    out: UInt8Array,
) -> None:
    """Fill `out` with the risks of all commands; humans at each step of the rollout, shape (T, N, 2)."""
    v_max, w_max, a_max, alpha_max, v_min, dt = limits
    for number in range(len(grid)):
        x, y, yaw, v, w = start
        risk = 0
        for k in range(len(humans)):
            held = k * dt < HOLD_S - 1e-9
            wanted_v = max(grid[number, 0] * v_max, v_min) if held else 0.0
            wanted_w = grid[number, 1] * w_max if held else 0.0
            v += min(max(wanted_v - v, -a_max * dt), a_max * dt)
            w += min(max(wanted_w - w, -alpha_max * dt), alpha_max * dt)
            middle = yaw + 0.5 * w * dt
            x, y, yaw = x + v * dt * math.cos(middle), y + v * dt * math.sin(middle), yaw + w * dt
            if _near_obstacle(occupied, clearance, frame, x, y, radii[0] + OBSTACLE_MARGIN_M):
                risk = OBSTACLE
                break
            if _near_human(humans[k], x, y, radii[1]):
                risk = HUMAN
                break
        out[number] = risk


@kernel_with_cache
def _near_obstacle(
    occupied: BoolArray,
    clearance: Float32Array,
    frame: tuple[float, float, float],
    x: float,
    y: float,
    radius: float,
) -> bool:
    origin_x, origin_y, resolution = frame
    i, j = math.floor((y - origin_y) / resolution), math.floor((x - origin_x) / resolution)
    if 0 <= i < occupied.shape[0] and 0 <= j < occupied.shape[1] and clearance[i, j] > radius + 0.71 * resolution:
        # Half a cell's diagonal covers the offset of the point from its cell's centre.
        return False
    return disc_meets_cells(occupied, origin_x, origin_y, resolution, x, y, radius)


@kernel_with_cache
def _near_human(humans: Float64Array, x: float, y: float, distance: float) -> bool:
    for m in range(len(humans)):
        dx, dy = humans[m, 0] - x, humans[m, 1] - y
        if dx * dx + dy * dy < distance * distance:
            return True
    return False
