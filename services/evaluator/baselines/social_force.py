"""The social force model on a robot: drawn along the shortest way, pushed away by humans and walls.

It knows the map and where all humans are and how they move, and plans nothing: a reactive, privileged baseline.
Source: Helbing & Molnar, Social force model for pedestrian dynamics, Phys. Rev. E 51 (1995); pushes from where
both will be nearest: Zanlungo, Ikeda & Kanda, Social force model with explicit collision prediction, EPL 93 (2011).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.services.evaluator.baselines.goal_field import GoalField

RELAXATION_S = 0.5
"""Time in which the robot takes up the velocity that it wants [s]."""
HUMAN_MPS2, HUMAN_M = 4.0, 0.5
"""Strength and reach of the push of a human."""
AHEAD_S, DECAY_S = 4.0, 3.0
"""A human pushes from where it will be nearest in this time, the less the later that is [s]."""
WALL_MPS2, WALL_M = 1.5, 0.15
"""Strength and reach of the push of a wall."""
BEHIND = 0.3
"""Share of its push that a human behind has."""
BRAKING = 0.7
"""Share of the largest deceleration that is counted on before walls."""
TOUCH_M = 0.03
"""Distance to walls that is kept [m]."""
LOOKAHEAD_M = 1.0
HEADING_GAIN_PER_S = 2.5


@dataclass
class SocialForceState:
    """State of one episode: its goal field and the humans' positions."""

    field: GoalField
    humans_before_m: np.ndarray
    """Positions of the humans at the last step [m], shape (N, 2)."""


class SocialForceDriver:
    """Follows the sum of forces."""

    looks = False

    def start(self, simulation: EpisodeSimulation) -> SocialForceState:
        """The ways to the episode's goal."""
        goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
        field = GoalField(simulation.robot_map, simulation.robot.planning_radius_m, (goal_x, goal_y))
        return SocialForceState(field, simulation.human_xy_m.copy())

    def act(self, running: Sequence[tuple[EpisodeSimulation, SocialForceState]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        return [self._command(simulation, walk) for simulation, walk in running]

    def _command(self, simulation: EpisodeSimulation, walk: SocialForceState) -> tuple[float, float]:
        humans = simulation.human_xy_m
        velocities = (humans - walk.humans_before_m) / simulation.clock.dt_s
        walk.humans_before_m = humans.copy()
        vx, vy = self._wanted_velocity(simulation, walk.field, humans, velocities)
        speed, heading = math.hypot(vx, vy), math.atan2(vy, vx)
        off = (heading - simulation.yaw_rad + math.pi) % (2 * math.pi) - math.pi
        w = min(max(HEADING_GAIN_PER_S * off, -simulation.robot.w_max_radps), simulation.robot.w_max_radps)
        v = max(0.0, math.cos(off)) * min(speed, simulation.robot.v_max_mps, _safe_speed(simulation, walk.field))
        return v, w if speed > 0.05 else 0.0

    def _wanted_velocity(
        self, simulation: EpisodeSimulation, field: GoalField, humans: np.ndarray, velocities: np.ndarray
    ) -> tuple[float, float]:
        x, y = simulation.x_m, simulation.y_m
        to_x, to_y = field.ahead(x, y, LOOKAHEAD_M)
        ahead_m = max(math.hypot(to_x - x, to_y - y), 1e-6)
        wish = (simulation.robot.v_max_mps * (to_x - x) / ahead_m, simulation.robot.v_max_mps * (to_y - y) / ahead_m)
        fx, fy = _wall_push(simulation, field)
        for (human_x, human_y), velocity in zip(humans.tolist(), velocities.tolist(), strict=True):
            px, py = _human_push((x - human_x, y - human_y), velocity, wish, simulation.contact_m)
            fx, fy = fx + px, fy + py
        # Where the pushes would take the wanted velocity in the relaxation time.
        return wish[0] + RELAXATION_S * fx, wish[1] + RELAXATION_S * fy


def _human_push(
    offset_m: tuple[float, float], velocity: tuple[float, float], wish: tuple[float, float], contact_m: float
) -> tuple[float, float]:
    """Acceleration away from where a human and the robot will be nearest [m/s2]."""
    relative = (wish[0] - velocity[0], wish[1] - velocity[1])
    speed2 = relative[0] ** 2 + relative[1] ** 2
    closing = -(offset_m[0] * relative[0] + offset_m[1] * relative[1])
    time_s = min(max(closing / speed2, 0.0), AHEAD_S) if speed2 > 1e-9 else 0.0
    nearest = (offset_m[0] + time_s * relative[0], offset_m[1] + time_s * relative[1])
    distance = math.hypot(*nearest)
    gap_m = distance - contact_m
    if distance < 1e-6:
        # Head on: to the right.
        nearest, distance = (wish[1], -wish[0]), max(math.hypot(*wish), 1e-6)
    cosine = -(offset_m[0] * wish[0] + offset_m[1] * wish[1]) / max(math.hypot(*offset_m) * math.hypot(*wish), 1e-9)
    facing = BEHIND + (1 - BEHIND) * (1 + cosine) / 2
    push = HUMAN_MPS2 * facing * math.exp(-max(gap_m, 0.0) / HUMAN_M - time_s / DECAY_S)
    return push * nearest[0] / max(distance, 1e-6), push * nearest[1] / max(distance, 1e-6)


def _safe_speed(simulation: EpisodeSimulation, field: GoalField) -> float:
    """The speed from which the robot can stop before it touches what is ahead [m/s], regardless of the forces on it."""
    robot, x, y, yaw = simulation.robot, simulation.x_m, simulation.y_m, simulation.yaw_rad
    stop_m = robot.v_max_mps**2 / (2 * BRAKING * robot.a_max_mps2) + TOUCH_M
    steps = np.arange(TOUCH_M, stop_m + TOUCH_M, TOUCH_M)
    clearances = field.clearances_m(np.column_stack([x + steps * math.cos(yaw), y + steps * math.sin(yaw)]))
    blocked = np.flatnonzero(clearances <= robot.radius_m + TOUCH_M)
    free_m = float(steps[blocked[0]]) - 2 * TOUCH_M if blocked.size else math.inf
    return math.sqrt(2 * BRAKING * robot.a_max_mps2 * max(free_m, 0.0))


def _wall_push(simulation: EpisodeSimulation, field: GoalField) -> tuple[float, float]:
    """Acceleration along the gradient of the free space [m/s2]."""
    frame, clearance = simulation.robot_map.frame, field.clearance_m
    i, j = frame.cell(simulation.x_m, simulation.y_m)
    if not (0 < i < clearance.shape[0] - 1 and 0 < j < clearance.shape[1] - 1):
        return 0.0, 0.0
    gx, gy = float(clearance[i, j + 1] - clearance[i, j - 1]), float(clearance[i + 1, j] - clearance[i - 1, j])
    norm = math.hypot(gx, gy)
    if norm < 1e-9:
        return 0.0, 0.0
    push = WALL_MPS2 * math.exp(-max(float(clearance[i, j]) - simulation.robot.radius_m, 0.0) / WALL_M)
    return push * gx / norm, push * gy / norm
