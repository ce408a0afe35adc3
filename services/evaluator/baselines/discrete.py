"""A discrete planner on the map, as GaussNav has one: forward 0.25 m or turn by 30 degrees, along the shortest way.

It knows the map, and of humans nothing: a privileged baseline of the static task. Robots of Habitat slide along what
they touch; here that ends an episode, so that a step forward is only taken where there is room for it.
Source: Lei et al., GaussNav: Gaussian splatting for visual navigation, 2024: actions of Habitat, ways on a grid.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.services.evaluator.baselines.goal_field import GoalField

FORWARD_M = 0.25
TURN_RAD = math.radians(30.0)
TURNS = round(math.pi / TURN_RAD)
"""Turns that make the robot look back."""
TURN_COST_M = 0.03
"""Way that is gone rather than turn once more [m]."""
LOOK_STEPS = 2
"""Steps forward that are thought of in advance."""
HALT_MPS, HALT_RADPS = 0.02, 0.02
"""A robot this slow stands: the next action may begin."""


@dataclass
class Action:
    """Rest of an action: distance [m] and turn [rad]."""

    forward_m: float = 0.0
    turn_rad: float = 0.0


@dataclass
class DiscretePlan:
    """State of one episode: its goal field and the rest of the present action."""

    field: GoalField
    action: Action


class DiscretePlannerDriver:
    """One action after the other; the robot stands between them, unless it goes straight on."""

    looks = False

    def start(self, simulation: EpisodeSimulation) -> DiscretePlan:
        """The ways to the episode's goal."""
        goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
        field = GoalField(simulation.robot_map, simulation.robot.planning_radius_m, (goal_x, goal_y))
        return DiscretePlan(field, Action())

    def act(self, running: Sequence[tuple[EpisodeSimulation, DiscretePlan]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        return [self._command(simulation, plan) for simulation, plan in running]

    def _command(self, simulation: EpisodeSimulation, plan: DiscretePlan) -> tuple[float, float]:
        action, robot, clock = plan.action, simulation.robot, simulation.clock
        held_s = clock.dt_s * clock.control_every
        action.forward_m -= simulation.v_mps * clock.dt_s if simulation.step else 0.0
        action.turn_rad -= simulation.w_radps * clock.dt_s if simulation.step else 0.0
        v = _braking(action.forward_m, robot.a_max_mps2, robot.v_max_mps, held_s)
        w = _braking(action.turn_rad, robot.alpha_max_radps2, robot.w_max_radps, held_s)
        if action.forward_m > 0 and action.forward_m <= _brakes_in(simulation.v_mps, robot.a_max_mps2, held_s):
            # A robot that continues in the same direction need not stop.
            action.forward_m += self._next_action(simulation, plan.field, action.forward_m).forward_m
            v = _braking(action.forward_m, robot.a_max_mps2, robot.v_max_mps, held_s)
        stands = abs(simulation.v_mps) < HALT_MPS and abs(simulation.w_radps) < HALT_RADPS
        if abs(v) < HALT_MPS and abs(w) < HALT_RADPS and stands:
            plan.action = self._next_action(simulation, plan.field)
            v = _braking(plan.action.forward_m, robot.a_max_mps2, robot.v_max_mps, held_s)
            w = _braking(plan.action.turn_rad, robot.alpha_max_radps2, robot.w_max_radps, held_s)
        return max(v, 0.0), w

    def _next_action(self, simulation: EpisodeSimulation, field: GoalField, left_m: float = 0.0) -> Action:
        """The action after one that still goes `left_m` forward."""
        yaw = simulation.yaw_rad
        x, y = simulation.x_m + left_m * math.cos(yaw), simulation.y_m + left_m * math.sin(yaw)
        turns, _ = _best_turns(field, x, y, yaw, LOOK_STEPS)
        return Action(turn_rad=math.copysign(TURN_RAD, turns)) if turns else Action(forward_m=FORWARD_M)


def _best_turns(field: GoalField, x_m: float, y_m: float, yaw_rad: float, steps: int) -> tuple[int, float]:
    """Turns before the next step forward, to the left above 0, and how long the way to the goal is then [m]."""
    best = (0, math.inf)
    for turns in sorted(range(-TURNS + 1, TURNS + 1), key=abs):
        yaw = yaw_rad + turns * TURN_RAD
        to_x, to_y = x_m + FORWARD_M * math.cos(yaw), y_m + FORWARD_M * math.sin(yaw)
        if not field.is_free((x_m, y_m), (to_x, to_y)):
            continue
        rest_m = field.distance_m(to_x, to_y)
        if steps > 1 and rest_m > FORWARD_M:
            rest_m = _best_turns(field, to_x, to_y, yaw, steps - 1)[1]
        way_m = FORWARD_M + rest_m + TURN_COST_M * abs(turns)
        if way_m < best[1] - 1e-9:
            best = (turns, way_m)
    return best


def _braking(left: float, slowing: float, largest: float, held_s: float) -> float:
    """The fastest velocity from which what is left can still be braked in, in steps of `held_s`."""
    speed = math.sqrt((0.5 * slowing * held_s) ** 2 + 2 * slowing * abs(left)) - 0.5 * slowing * held_s
    return math.copysign(min(speed, largest, abs(left) / held_s), left)


def _brakes_in(speed: float, slowing: float, held_s: float) -> float:
    """Way until a robot stands, if it begins to brake in the next step [m]."""
    return speed * speed / (2 * slowing) + 2 * speed * held_s
