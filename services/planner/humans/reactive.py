"""People who yield: the drawn trajectories, walked again among each other and beside the expert's robot.

Everybody follows the drawn rows and, at each step, takes the velocity of a fan around the wanted one that costs least:
how far it is off, and how soon it touches the robot or somebody else if nobody changes course. Whoever is outside of a
person's view, or behind an obstacle, is not there for that person. Walls are never touched.
Source: van den Berg, Lin, Manocha, Reciprocal velocity obstacles for real-time multi-agent navigation, ICRA 2008
(sampled velocities and the penalty of time to collision; here each one avoids fully instead of by half).
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.episode.collision import disc_meets_cells
from readygo.common.episode.grid_search import line_is_free
from readygo.common.episode.simulation import time_to_contact_s
from readygo.common.kernels import compiled
from readygo.common.maps import OccupancyMap
from readygo.common.messages import EpisodeMotions, HumanMotion, Motion, Outcome, Scenario
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S, RATE_HZ
from readygo.services.planner.config import HumanPlannerConfig
from readygo.services.planner.humans.spline import length_m
from readygo.services.planner.humans.walk import held

Float64Array = npt.NDArray[np.float64]

_AHEAD_ROWS = 20
_BEHIND_M = 0.35
"""Who is farther from the drawn row than this waits for no clock: the row waits [m]."""
_HORIZON_S = 3.0
_ROOM_M = 0.3
"""Distance that people try to keep beyond touching [m]; with less, a run that differs a little ends in a collision."""
_ACCELERATION_MPS2 = 2.0
_SHARES = np.array([1.0, 0.75, 0.5, 0.25, 0.0])
_TURNS_RAD = np.radians(np.array([0.0, 15.0, -15.0, 30.0, -30.0, 50.0, -50.0, 75.0, -75.0]))
_HURRY_COST, _CHANGE_COST = 2.0, 0.15

_contact_s = compiled(time_to_contact_s)


class ReactivePeople:
    """The people of a scenario, step by step."""

    def __init__(
        self,
        drawn_m: Sequence[Float64Array],
        reacts: Sequence[bool],
        human_map: OccupancyMap,
        contact_m: float,
        episode: EpisodeConfig,
        config: HumanPlannerConfig,
    ) -> None:
        """Put everybody at their first row.

        Args:
            drawn_m: The drawn trajectories, shape (T, 2) each.
            reacts: Who yields; the others keep to their rows.
            human_map: What blocks people.
            contact_m: Distance at which robot and person touch [m].
            episode: Radius of people.
            config: What people see.
        """
        self._drawn, self._reacts = drawn_m, np.array(reacts, np.bool_)
        self._radius_m = episode.human_radius_m
        frame = human_map.frame
        self._ground = (human_map.occupied, frame.origin_x_m, frame.origin_y_m, frame.resolution_m)
        self._free = np.where(human_map.occupied, np.uint8(0), np.uint8(1))
        self._view = (math.cos(0.5 * math.radians(config.reactive_cone_deg)), config.reactive_range_m)
        self._contact_m = contact_m
        self._row = [0] * len(drawn_m)
        self._velocity = np.array([_first_velocity(rows) for rows in drawn_m])
        self._heading = np.array([_unit(rows[-1] - rows[0]) for rows in drawn_m])
        self.xy_m = [np.array([rows[0] for rows in drawn_m])]
        """Positions by step, each of shape (N, 2)."""

    @property
    def at_rest(self) -> bool:
        """True if everybody has arrived."""
        arrived = all(row == len(rows) - 1 for row, rows in zip(self._row, self._drawn, strict=True))
        return arrived and bool(np.all(np.abs(self._velocity) < 0.02))

    def advance(self, robot: tuple[float, float, float, float] | None) -> None:
        """One step.

        Args:
            robot: Its x, y [m] and velocity [m/s] in the world now; None if it is gone.
        """
        now, velocity = self.xy_m[-1], self._velocity.copy()
        place = now.copy()
        others = [(*now[k].tolist(), *velocity[k].tolist()) for k in range(len(now))]
        for k, rows in enumerate(self._drawn):
            if not self._reacts[k]:
                self._row[k] = min(self._row[k] + 1, len(rows) - 1)
                place[k] = rows[self._row[k]]
            else:
                place[k] = self._yielding(k, now[k], [o for j, o in enumerate(others) if j != k], robot)
            self._velocity[k] = (place[k] - now[k]) / DT_S
            if math.hypot(*self._velocity[k].tolist()) > 0.2:
                self._heading[k] = _unit(self._velocity[k])
        self.xy_m.append(place)

    def _yielding(
        self,
        k: int,
        here: Float64Array,
        others: list[tuple[float, float, float, float]],
        robot: tuple[float, float, float, float] | None,
    ) -> Float64Array:
        """Where person k goes in this step."""
        rows = self._drawn[k]
        row = self._row[k] = _next_row(rows, self._row[k], here)
        ahead = min(row + _AHEAD_ROWS, len(rows) - 1)
        ahead_s = max((ahead - row) * DT_S, 0.4)
        free_mps = max(1.1 * length_m(rows[row : ahead + 1]) / ahead_s, 0.4)
        discs = [(*other, 2 * self._radius_m) for other in others]
        if robot is not None:
            discs.append((*robot, self._contact_m))
        step: Float64Array = _step(
            here,
            self._velocity[k],
            self._heading[k],
            rows[ahead],
            min(free_mps, math.dist(here.tolist(), rows[ahead].tolist()) / ahead_s),
            np.array(discs).reshape(-1, 5),
            self._view,
            self._free,
            self._ground,
            self._radius_m,
        )
        return step


class ReactiveSimulation(EpisodeSimulation):
    """An episode whose people look at the robot, instead of following motions."""

    def __init__(
        self,
        scenario: Scenario,
        people: ReactivePeople,
        robot_map: OccupancyMap,
        robot: RobotConfig,
        episode_config: EpisodeConfig,
    ) -> None:
        self._people = people
        self._stand_ins = stand_ins(scenario, round(episode_config.time_limit_s * RATE_HZ) + 1)
        super().__init__(scenario, self._stand_ins, robot_map, robot, episode_config)

    def human_xy_at(self, step: int) -> Float64Array:
        """Where the people are at a step [m], shape (N, 2); in the future, where they were drawn to be."""
        walked = self._people.xy_m
        return walked[step] if step < len(walked) else super().human_xy_at(step)

    def advance(self, v_mps: float, w_radps: float) -> Outcome | None:
        """See `EpisodeSimulation.advance`; people see where the robot is before it moves."""
        vx, vy = self.v_mps * math.cos(self.yaw_rad), self.v_mps * math.sin(self.yaw_rad)
        self._people.advance((self.x_m, self.y_m, vx, vy))
        for human, xy in zip(self._stand_ins.humans, self._people.xy_m[-1], strict=True):
            human.motion.root_m[self.step + 1, :2] = xy
        return super().advance(v_mps, w_radps)


def stand_ins(scenario: Scenario, count: int) -> EpisodeMotions:
    """Motions of people whose arms hang, along the drawn trajectories; the simulation moves them as it goes."""
    humans = []
    for human in scenario.humans:
        root, pose = np.zeros((count, 3), np.float32), np.zeros((count, 24, 3), np.float32)
        root[:, :2], root[:, 2] = held(human.xy_m, count), 0.9
        # The shoulders: SMPL's figure without rotations holds its arms out.
        pose[:, 16, 2], pose[:, 17, 2] = -1.3, 1.3
        humans.append(HumanMotion(avatar=human.avatar, motion=Motion(root_m=root, pose_axis_angle=pose)))
    return EpisodeMotions(humans=tuple(humans))


def reacted(scenario: Scenario, people: ReactivePeople) -> Scenario:
    """The scenario with the trajectories that its people have walked, without the standing at their ends."""
    walked = np.array(people.xy_m)
    humans = []
    for k, human in enumerate(scenario.humans):
        rows = walked[:, k]
        moving = np.flatnonzero(np.any(rows[1:] != rows[:-1], axis=1))
        last = int(moving[-1]) + 2 if len(moving) else 1
        humans.append(dataclasses.replace(human, xy_m=np.ascontiguousarray(rows[:last])))
    return dataclasses.replace(scenario, humans=tuple(humans))


def _first_velocity(rows: Float64Array) -> Float64Array:
    velocity: Float64Array = (rows[1] - rows[0]) / DT_S if len(rows) > 1 else np.zeros(2)
    return velocity


def _unit(vector: Float64Array) -> Float64Array:
    return vector / max(math.hypot(*vector.tolist()), 1e-9)


@compiled
def _next_row(rows: Float64Array, row: int, here: Float64Array) -> int:
    """The drawn row that somebody is to follow next: it waits for who is late and hurries for who is early."""
    last = len(rows) - 1
    gap = math.sqrt((rows[row, 0] - here[0]) ** 2 + (rows[row, 1] - here[1]) ** 2)
    if gap < _BEHIND_M:
        return min(row + 1, last)
    while row < last:
        onward = math.sqrt((rows[row + 1, 0] - here[0]) ** 2 + (rows[row + 1, 1] - here[1]) ** 2)
        if onward >= gap:
            break
        gap, row = onward, row + 1
    return row


@compiled
def _step(
    here: Float64Array,
    velocity: Float64Array,
    heading: Float64Array,
    target: Float64Array,
    wanted: float,
    discs: Float64Array,
    view: tuple[float, float],
    free: npt.NDArray[np.uint8],
    ground: tuple[npt.NDArray[np.bool_], float, float, float],
    radius: float,
) -> Float64Array:
    """Where a person goes in one step: towards the target [m] at the wanted speed [m/s], off the discs that it sees.

    Discs are x, y [m], vx, vy [m/s] and the distance of contact [m], shape (N, 5).
    """
    occupied, ox, oy, res = ground
    seen = np.zeros(len(discs), np.bool_)
    for d in range(len(discs)):
        dx, dy = discs[d, 0] - here[0], discs[d, 1] - here[1]
        away = max(math.sqrt(dx * dx + dy * dy), 1e-9)
        inside = away <= view[1] and dx * heading[0] + dy * heading[1] >= view[0] * away
        seen[d] = inside and line_is_free(
            free,
            (here[1] - oy) / res,
            (here[0] - ox) / res,
            (discs[d, 1] - oy) / res,
            (discs[d, 0] - ox) / res,
            1,
        )
    px, py = target[0] - here[0], target[1] - here[1]
    distance = math.sqrt(px * px + py * py)
    if distance < 1e-9:
        px, py = heading[0], heading[1]
    else:
        px, py = px / distance, py / distance
    top = max(wanted, 0.6)
    best, vx, vy = np.inf, 0.0, 0.0
    for turn in _TURNS_RAD:
        c, s = math.cos(turn), math.sin(turn)
        for share in _SHARES:
            # Straight on the shares are of the wanted speed, aside of what it takes to get out of the way.
            speed = share * (wanted if turn == 0.0 else top)
            ux, uy = speed * (c * px - s * py), speed * (s * px + c * py)
            cost = _cost(here, ux, uy, velocity, (wanted * px, wanted * py), discs, seen)
            if cost < best and _is_free(here, ux, uy, occupied, ox, oy, res, radius + 0.06):
                best, vx, vy = cost, ux, uy
    # Nobody changes speed at once.
    ax, ay = vx - velocity[0], vy - velocity[1]
    scale = min(1.0, _ACCELERATION_MPS2 * DT_S / max(math.sqrt(ax * ax + ay * ay), 1e-9))
    x, y = here[0] + (velocity[0] + scale * ax) * DT_S, here[1] + (velocity[1] + scale * ay) * DT_S
    if disc_meets_cells(occupied, ox, oy, res, x, y, radius + 0.03):
        x, y = here[0], here[1]
    return np.array([x, y])


@compiled
def _cost(
    here: Float64Array,
    ux: float,
    uy: float,
    velocity: Float64Array,
    wanted: tuple[float, float],
    discs: Float64Array,
    seen: npt.NDArray[np.bool_],
) -> float:
    """How much a velocity differs from the wanted and the present one [m/s], and how soon it touches somebody."""
    cost = math.sqrt((ux - wanted[0]) ** 2 + (uy - wanted[1]) ** 2)
    cost += _CHANGE_COST * math.sqrt((ux - velocity[0]) ** 2 + (uy - velocity[1]) ** 2)
    for d in range(len(discs)):
        if not seen[d]:
            continue
        dx, dy = discs[d, 0] - here[0], discs[d, 1] - here[1]
        vx, vy = discs[d, 2] - ux, discs[d, 3] - uy
        contact = discs[d, 4] + _ROOM_M
        away = math.sqrt(dx * dx + dy * dy)
        if away <= contact:
            # Too near already: what opens the gap costs nothing.
            cost += _HURRY_COST * max(0.0, -(dx * vx + dy * vy) / max(away, 1e-9))
            continue
        soon = _contact_s(dx, dy, vx, vy, contact)
        if soon < _HORIZON_S:
            cost += _HURRY_COST * (1.0 - soon / _HORIZON_S)
    return cost


@compiled
def _is_free(
    here: Float64Array,
    ux: float,
    uy: float,
    occupied: npt.NDArray[np.bool_],
    ox: float,
    oy: float,
    res: float,
    radius: float,
) -> bool:
    """True if a disc can move at a velocity for 0.6 s; standing is always possible."""
    if ux == 0.0 and uy == 0.0:
        return True
    for k in range(1, 5):
        x, y = here[0] + 0.15 * k * ux, here[1] + 0.15 * k * uy
        if disc_meets_cells(occupied, ox, oy, res, x, y, radius):
            return False
    return True
