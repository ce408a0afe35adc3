"""How a human yields: the velocity of a fan around the wanted one that costs least, compiled.

Legend: u a velocity of the fan, w the wanted one, v the present one [m/s]; a disc d at the offset (dx, dy) moves at
v_d, its relative velocity is v_d - u; t_d is the time until it is nearer than the distance of contact and `_ROOM_M`, H
= `_HORIZON_S`. Of the velocities at which the human meets no wall for 0.6 s the one with the smallest cost is taken:

    |u - w| + 0.15 |u - v| + sum over the discs in view of 2 max(0, 1 - t_d / H),

and for discs that are too near already 2 times the speed at which they come nearer. Source of choosing velocities by
the time to collision: van den Berg, Lin, Manocha, Reciprocal velocity obstacles, ICRA 2008.
"""

import math
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, UInt8Array
from readygo.common.episode.collision import disc_meets_cells
from readygo.common.episode.grid_search import line_is_free
from readygo.common.episode.simulation import time_to_contact_s
from readygo.common.kernels import kernel_with_cache
from readygo.common.robot.kinematics import DT_S

_BEHIND_M = 0.35
"""The drawn row waits for a human who is farther from it than this [m]."""
_HORIZON_S = 3.0
"""Contacts later than this cost nothing [s]."""
_ROOM_M = 0.3
"""Distance that humans try to keep beyond touching [m]; with less, a run that differs a little ends in a collision."""
_ACCELERATION_MPS2 = 2.0
_SHARES = np.array([1.0, 0.75, 0.5, 0.25, 0.0])
"""Speeds of the fan, as shares of the wanted one."""
_TURNS_RAD = np.radians(np.array([0.0, 15.0, -15.0, 30.0, -30.0, 50.0, -50.0, 75.0, -75.0]))
"""Directions of the fan, from that of the target; of equal costs the first one wins."""
_ASIDE_MPS = 0.6
"""Speed at which a human may step aside, however slow it wants to be."""
_HURRY_COST, _CHANGE_COST = 2.0, 0.15
"""Cost of an immediate contact, and of a change of velocity by 1 m/s [m/s]."""
_WALL_ROOM_M, _WALL_ROOM_MIN_M = 0.06, 0.03
"""Distance to walls that chosen velocities keep, and that every step keeps, beyond the radius [m]."""
_CHECKS, _CHECK_S = 4, 0.15
"""Velocities are checked against walls at so many times, so far apart [s]."""
_X, _Y, _VX, _VY, _CONTACT = 0, 1, 2, 3, 4
"""Places in a disc."""

_contact_s = kernel_with_cache(time_to_contact_s)


class Cells(NamedTuple):
    """Map of what blocks humans."""

    occupied: BoolArray
    """True where something blocks humans, shape (H, W)."""
    free: UInt8Array
    """1 where `occupied` is False, shape (H, W)."""
    origin_x_m: float
    origin_y_m: float
    resolution_m: float


class Sight(NamedTuple):
    """What a human sees, walls aside."""

    cos_half_cone: float
    """Cosine of half the cone's width."""
    range_m: float


class Wish(NamedTuple):
    """One human in motion, and where it would like to go."""

    here_m: Float64Array
    velocity_mps: Float64Array
    heading: Float64Array
    """Unit vector that the human faces, shape (2,)."""
    target_m: Float64Array
    speed_mps: float


@kernel_with_cache
def next_row(rows: Float64Array, row: int, here: Float64Array) -> int:
    """The drawn row that a human is to follow next: it waits for a late human and hurries for an early one."""
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


@kernel_with_cache
def next_place(wish: Wish, discs: Float64Array, sight: Sight, cells: Cells, radius: float) -> Float64Array:
    """Where a human goes in one step: towards the target at the wanted speed, off the discs that it sees.

    Args:
        wish: The human.
        discs: x, y [m], vx, vy [m/s] and the distance of contact [m] of everybody else, shape (N, 5).
        sight: What it sees.
        cells: What blocks it.
        radius: Its own [m].
    """
    here, velocity, heading, target, wanted = wish
    seen = _discs_in_view(here, heading, discs, sight, cells)
    px, py = target[0] - here[0], target[1] - here[1]
    distance = math.sqrt(px * px + py * py)
    if distance < 1e-9:
        px, py = heading[0], heading[1]
    else:
        px, py = px / distance, py / distance
    # (px, py): the direction of the target.
    top = max(wanted, _ASIDE_MPS)
    best, vx, vy = np.inf, 0.0, 0.0
    for turn in _TURNS_RAD:
        c, s = math.cos(turn), math.sin(turn)
        for share in _SHARES:
            # Straight on the shares are of the wanted speed, aside of what it takes to get out of the way.
            speed = share * (wanted if turn == 0.0 else top)
            ux, uy = speed * (c * px - s * py), speed * (s * px + c * py)
            cost = _cost(here, ux, uy, velocity, (wanted * px, wanted * py), discs, seen)
            if cost < best and _is_free(here, ux, uy, cells, radius + _WALL_ROOM_M):
                best, vx, vy = cost, ux, uy
    # Humans change speed gradually.
    ax, ay = vx - velocity[0], vy - velocity[1]
    scale = min(1.0, _ACCELERATION_MPS2 * DT_S / max(math.sqrt(ax * ax + ay * ay), 1e-9))
    x, y = here[0] + (velocity[0] + scale * ax) * DT_S, here[1] + (velocity[1] + scale * ay) * DT_S
    occupied, _, ox, oy, res = cells
    if disc_meets_cells(occupied, ox, oy, res, x, y, radius + _WALL_ROOM_MIN_M):
        x, y = here[0], here[1]
    return np.array([x, y])


@kernel_with_cache
def _discs_in_view(
    here: Float64Array, heading: Float64Array, discs: Float64Array, sight: Sight, cells: Cells
) -> BoolArray:
    """Which discs are in view: near, within the cone, behind no wall."""
    _, free, ox, oy, res = cells
    seen = np.zeros(len(discs), np.bool_)
    for d in range(len(discs)):
        dx, dy = discs[d, _X] - here[0], discs[d, _Y] - here[1]
        away = max(math.sqrt(dx * dx + dy * dy), 1e-9)
        inside = away <= sight.range_m and dx * heading[0] + dy * heading[1] >= sight.cos_half_cone * away
        seen[d] = inside and line_is_free(
            free,
            (here[1] - oy) / res,
            (here[0] - ox) / res,
            (discs[d, _Y] - oy) / res,
            (discs[d, _X] - ox) / res,
            1,
        )
    return seen


@kernel_with_cache
def _cost(
    here: Float64Array,
    ux: float,
    uy: float,
    velocity: Float64Array,
    wanted: tuple[float, float],
    discs: Float64Array,
    seen: BoolArray,
) -> float:
    """Cost of a velocity [m/s]: its difference from the wanted and the present one, and how soon it touches a disc."""
    cost = math.sqrt((ux - wanted[0]) ** 2 + (uy - wanted[1]) ** 2)
    cost += _CHANGE_COST * math.sqrt((ux - velocity[0]) ** 2 + (uy - velocity[1]) ** 2)
    for d in range(len(discs)):
        if not seen[d]:
            continue
        dx, dy = discs[d, _X] - here[0], discs[d, _Y] - here[1]
        vx, vy = discs[d, _VX] - ux, discs[d, _VY] - uy
        contact = discs[d, _CONTACT] + _ROOM_M
        away = math.sqrt(dx * dx + dy * dy)
        if away <= contact:
            # Too near already: what opens the gap costs nothing.
            cost += _HURRY_COST * max(0.0, -(dx * vx + dy * vy) / max(away, 1e-9))
            continue
        soon = _contact_s(dx, dy, vx, vy, contact)
        if soon < _HORIZON_S:
            cost += _HURRY_COST * (1.0 - soon / _HORIZON_S)
    return cost


@kernel_with_cache
def _is_free(here: Float64Array, ux: float, uy: float, cells: Cells, radius: float) -> bool:
    """True if a disc can move at a velocity for `_CHECKS` times `_CHECK_S`; standing is always possible."""
    if ux == 0.0 and uy == 0.0:
        return True
    occupied, _, ox, oy, res = cells
    for k in range(1, _CHECKS + 1):
        x, y = here[0] + _CHECK_S * k * ux, here[1] + _CHECK_S * k * uy
        if disc_meets_cells(occupied, ox, oy, res, x, y, radius):
            return False
    return True
