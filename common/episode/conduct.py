"""How a run treated people and how smoothly it drove: what a success rate does not tell."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array

PERSONAL_SPACE_M = 0.5
"""Free space between robot and human below which the robot intrudes [m].
Source: Francis et al., Principles and guidelines for evaluating social robot navigation algorithms, 2023."""
COMPLIANCE_M = 1.0
"""Distance of the centres of robot and human below which the robot does not comply with personal space [m].
Source: Falcon (Gong et al., arXiv:2409.13244) and its challenge, "the threshold is set to 1.0 m, considering a 0.3 m
human radius and 0.25 m robot radius"."""
NEAR_MISS_M = 0.2
"""Free space below which an encounter without contact is a near miss [m]."""
MOVING_MPS = 0.1
"""A robot that touches a human at a lower speed counts as standing [m/s]."""
REACTION_S = 1.0
"""A human who was in view for this long could have been avoided [s]."""

Sees = Callable[[tuple[float, float, float], tuple[float, float]], bool]
"""Whether a camera shows a human: robot's x [m], y [m], yaw [rad]; human's x and y [m]."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """How robot and human met that collided."""

    robot_mps: float
    """Velocity of the robot [m/s], negative backwards."""
    in_view: bool
    """True if the robot's camera showed the human then."""
    seen_s: float
    """How long it had shown the human before, in all [s]."""

    @property
    def robot_moved(self) -> bool:
        """False if a human walked into a robot that stood."""
        return abs(self.robot_mps) >= MOVING_MPS

    @property
    def at_fault(self) -> bool:
        """True if the robot moved and had seen the human for long enough to react."""
        return self.robot_moved and self.seen_s >= REACTION_S


@dataclass(frozen=True, kw_only=True)
class Conduct:
    """Social measures of one run."""

    intrusion_s: float
    """Time in a human's personal space [s]."""
    near_misses: int
    """Encounters that came nearer than `NEAR_MISS_M` and did not end in contact."""
    jerk_mps3: float
    """Root mean square of the second derivative of the speed [m/s3]."""
    turn_acceleration_radps2: float
    """Mean of the turn rate's change, without its sign [rad/s2]."""
    contact: Contact | None = None
    """The contact that ended the run; None if the robot did not touch a human."""
    too_close_s: float | None = None
    """Time with the centre of a human within `COMPLIANCE_M` [s]; None in records that did not measure it."""
    collision_time_min_s: float | None = None
    """Shortest time until robot and a human would touch if both kept their velocities [s]; None if they never would."""


def conduct_of(
    poses: Float64Array,
    actions: Float64Array,
    human_xy_m: Float64Array,
    *,
    dt_s: float,
    contact_m: float,
    sees: Sees,
) -> Conduct:
    """Measure a run.

    Args:
        poses: Robot's x [m], y [m], yaw [rad] at all steps and at the end, shape (T + 1, 3).
        actions: Executed commands v [m/s], w [rad/s], shape (T, 2).
        human_xy_m: Where the humans were at the same times [m], shape (T + 1, N, 2).
        dt_s: Time between two steps [s].
        contact_m: Distance of the centres at which robot and human touch [m].
        sees: Whether the camera shows a human; only asked about humans that were touched.
    """
    gap_m = np.hypot(*np.moveaxis(human_xy_m - poses[:, None, :2], 2, 0)) - contact_m
    nearest_m = gap_m.min(axis=1) if gap_m.shape[1] else np.full(len(poses), math.inf)
    touched = nearest_m[-1] < 0
    return Conduct(
        intrusion_s=float(np.count_nonzero(nearest_m[1:] < PERSONAL_SPACE_M) * dt_s),
        near_misses=sum(_spells(gap_m[:, k]) for k in range(gap_m.shape[1])),
        jerk_mps3=_root_mean_square(np.diff(actions[:, 0], n=2) / dt_s**2),
        turn_acceleration_radps2=float(np.mean(np.abs(np.diff(actions[:, 1])))) / dt_s if len(actions) > 1 else 0.0,
        contact=_contact(poses, actions, human_xy_m[:, int(gap_m[-1].argmin())], dt_s, sees) if touched else None,
        too_close_s=float(np.count_nonzero(nearest_m[1:] + contact_m < COMPLIANCE_M) * dt_s),
        collision_time_min_s=shortest_collision_time_s(poses[:, :2], human_xy_m, dt_s=dt_s, contact_m=contact_m),
    )


def shortest_collision_time_s(
    robot_xy_m: Float64Array, human_xy_m: Float64Array, *, dt_s: float, contact_m: float
) -> float | None:
    """Shortest time to collision (TTC) of a run: two discs that keep their velocities of the last step.

    With p and u the human's position and velocity relative to the robot's, they touch at the smaller root t of
    |p + u t| = d, that is t = (-p.u - sqrt((p.u)^2 - u.u (p.p - d^2))) / u.u, if they approach (p.u < 0).

    Args:
        robot_xy_m: Robot's positions, shape (T + 1, 2).
        human_xy_m: Humans' positions at the same times, shape (T + 1, N, 2).
        dt_s: Time between two steps [s].
        contact_m: Distance d of the centres at which they touch [m].

    Returns:
        Time [s], 0 after a contact; None if they are never on a collision course.

    Source: van den Berg, Lin, Manocha, Reciprocal velocity obstacles, ICRA 2008 (time to collision of discs).
    """
    p = human_xy_m - robot_xy_m[:, None]
    u, p = np.diff(p, axis=0) / dt_s, p[1:]
    pu, uu, pp = (np.sum(a * b, axis=2) for a, b in ((p, u), (u, u), (p, p)))
    inside = pu * pu - uu * (pp - contact_m * contact_m)
    on_course = (pu < 0) & (inside >= 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where(on_course, (-pu - np.sqrt(np.maximum(inside, 0.0))) / uu, np.inf)
    shortest = float(np.min(np.where(pp < contact_m * contact_m, 0.0, times), initial=np.inf))
    return max(shortest, 0.0) if math.isfinite(shortest) else None


def _contact(poses: Float64Array, actions: Float64Array, human_m: Float64Array, dt_s: float, sees: Sees) -> Contact:
    seen = [
        sees((x, y, yaw), (human_x, human_y))
        for (x, y, yaw), (human_x, human_y) in zip(poses.tolist(), human_m.tolist(), strict=True)
    ]
    return Contact(
        robot_mps=float(actions[-1, 0]) if len(actions) else 0.0, in_view=seen[-1], seen_s=sum(seen[:-1]) * dt_s
    )


def _spells(gap_m: Float64Array) -> int:
    """How often a gap fell below `NEAR_MISS_M` and rose again without a contact; one at the end counts."""
    near = np.concatenate([[False], gap_m < NEAR_MISS_M, [False]])
    begins, ends = np.flatnonzero(near[1:] & ~near[:-1]), np.flatnonzero(near[:-1] & ~near[1:])
    return sum(bool(gap_m[begin:end].min() >= 0) for begin, end in zip(begins, ends, strict=True))


def _root_mean_square(values: Float64Array) -> float:
    return math.sqrt(float(np.mean(values**2))) if len(values) else 0.0
