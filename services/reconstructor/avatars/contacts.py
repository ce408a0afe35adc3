"""Soles that stand: where the floor is, which soles are on it, and how unlikely it is that they float or slip.

Legend: x_fk = sole k in frame f, one below the heel and one below the ball of each foot; h_fk = its height over the
floor; c_fk = 1 if it stands from frame f to the next; s_fk = mean of c_(f-1)k and c_fk.

    sum_fk s_fk (h_fk / sigma_h)^2 + (min(h_fk, 0) / sigma_b)^2 + c_fk rho(|x_(f+1)k - x_fk| / sigma_p)

with Geman and McClure's rho(r) = r^2 / (1 + r^2 / t^2). Source: Rempe et al., HuMoR, 2021 (contacts with the ground).
"""

from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import Float64Array

Tensor = torch.Tensor
_FLOOR_M, _BELOW_M, _PLANTED_M = 0.01, 0.02, 0.006
"""Deviations of soles that stand from the floor, of soles below it, and of what stands from frame to frame [m]."""
_SOLES = ((7, -0.04), (8, -0.04), (10, 0.0), (11, 0.0))
"""Joints above the soles' heels and balls, and how far behind these lie [m]."""
SOLE_JOINTS = [joint for joint, _ in _SOLES]
_CONTACT_HEIGHT_M, _CONTACT_STEP_M = 0.035, 0.03
"""Soles that are lower, and move less from frame to frame, stand on the floor."""
_ROBUST = 5.0
"""Scale t of the robust loss in sigmas."""
_TILT_RAD = 0.05
"""Standard deviation of the floor's normal from the direction that people are upright in, about each axis."""
_ROUNDS, _SLOW_MIN = 20, 8
"""Rounds of the robust fit of the floor, and how many heels and balls it needs."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Floor:
    """A plane, and how high heels and balls are where they stand on it: how thick soles are is not known."""

    up: Float64Array
    """Unit normal, shape (3,)."""
    heights_m: Float64Array
    """What up . x is for soles x that stand [m], shape (4,)."""

    def heights(self, soles_m: Tensor) -> Tensor:
        """How much higher soles (..., 4, 3) are than where they stand [m], shape (..., 4)."""
        over: Tensor = soles_m @ torch.from_numpy(self.up) - torch.from_numpy(self.heights_m)
        return over


LEVEL_FLOOR = Floor(up=np.array([0.0, 0.0, 1.0]), heights_m=np.zeros(len(_SOLES)))
_BALLS = np.array([0, 0, 1, 1])
"""Which soles are heels, and which are balls."""


def sole_offsets(tpose_m: Float64Array, ground_m: float) -> Tensor:
    """Where the soles are, from their joints in the T-pose [m], shape (4, 3).

    Args:
        tpose_m: Joints in the T-pose, y up [m], shape (24, 3).
        ground_m: y of the soles there [m].
    """
    rows = [(0.0, ground_m - tpose_m[joint, 1], back) for joint, back in _SOLES]
    return torch.tensor(rows, dtype=torch.float64)


def carry(A: Tensor, points_m: Tensor) -> Tensor:
    """Points (K, 3) after transforms (F, K, 3, 4), shape (F, K, 3)."""
    moved: Tensor = (A[..., :3] @ points_m[..., None])[..., 0] + A[..., 3]
    return moved


def find_floor(soles_m: Tensor, up: Float64Array) -> Floor | None:
    """The plane on which soles stand: a robust fit to those that hardly move; None if there are hardly any.

    Args:
        soles_m: Soles in F frames [m], shape (F, 4, 3).
        up: Direction in which the person is upright, unit vector, shape (3,).
    """
    slow = (soles_m[1:] - soles_m[:-1]).norm(dim=2) < _CONTACT_STEP_M
    points, kinds = (0.5 * (soles_m[1:] + soles_m[:-1]))[slow].numpy(), _BALLS[np.nonzero(slow.numpy())[1]]
    if np.bincount(kinds, minlength=2).min() < _SLOW_MIN:
        return None
    aside = np.linalg.svd(up[None])[2][1:]
    middle = points.mean(axis=0)
    # Rows: height over the middle = slope along two axes + constant of heels or balls; the last two rows are the
    # normal's prior.
    rows: Float64Array = np.concatenate([(points - middle) @ aside.T, np.eye(2)[kinds]], axis=1)
    heights = (points - middle) @ up
    prior = _FLOOR_M / _TILT_RAD * np.eye(2, 4)
    found = np.array([0.0, 0.0, *(np.quantile(heights[kinds == kind], 0.25) for kind in range(2))])
    for _ in range(_ROUNDS):
        r = (heights - rows @ found) / (_ROBUST * _FLOOR_M)
        weights = (1.0 / (1.0 + r**2))[:, None]
        found = np.linalg.lstsq(
            np.concatenate([weights * rows, prior]), np.append(weights[:, 0] * heights, [0.0, 0.0]), rcond=None
        )[0]
    normal = up - found[:2] @ aside
    length = float(np.linalg.norm(normal))
    return Floor(up=normal / length, heights_m=(normal @ middle + found[2:][_BALLS]) / length)


def find_contacts(soles_m: Tensor, floor: Floor) -> Tensor:
    """1 for soles that stand on the floor from one frame to the next, shape (F - 1, 4), for soles (F, 4, 3)."""
    low = floor.heights(soles_m) < _CONTACT_HEIGHT_M
    slow = (soles_m[1:] - soles_m[:-1]).norm(dim=2) < _CONTACT_STEP_M
    contacts: Tensor = (low[1:] & low[:-1] & slow).double()
    return contacts


def standing_share(contacts: Tensor) -> Tensor:
    """How far each sole stands in each frame, 0 to 1, shape (F, 4), for contacts (F - 1, 4)."""
    pad = torch.nn.functional.pad
    share: Tensor = 0.5 * (pad(contacts, (0, 0, 0, 1)) + pad(contacts, (0, 0, 1, 0)))
    return share


def settle_floor(soles_m: Tensor, contacts: Tensor, floor: Floor) -> Floor:
    """The floor where soles (F, 4, 3) that stand lie neither above it nor below in the mean, heels and balls alike.

    What `find_floor` takes for standing also holds feet that begin to rise, which are higher.
    """
    over, standing = floor.heights(soles_m).numpy(), standing_share(contacts).numpy()
    heights_m = floor.heights_m.copy()
    for kind in range(2):
        weight = standing[:, kind == _BALLS]
        if weight.any():
            heights_m[kind == _BALLS] += float(np.average(over[:, kind == _BALLS], weights=weight))
    return Floor(up=floor.up, heights_m=heights_m)


def lift_cost(heights_m: Tensor, standing: Tensor) -> Tensor:
    """How unlikely heights of soles over the floor are, for how far each stands, of the same shape."""
    cost: Tensor = (standing * (heights_m / _FLOOR_M).square()).sum()
    return cost


def sunk_cost(heights_m: Tensor) -> Tensor:
    """How unlikely heights of soles below the floor are, of any shape."""
    cost: Tensor = (torch.relu(-heights_m) / _BELOW_M).square().sum()
    return cost


def unknown_lift_cost(heights_m: Tensor) -> Tensor:
    """How unlikely heights (F, 4) are if it is not known which soles stand: the lowest of each frame should."""
    squares = (heights_m.amin(dim=1) / _FLOOR_M).square()
    cost: Tensor = (squares / (1.0 + squares / _ROBUST**2)).sum()
    return cost


def slip_cost(moved_m: Tensor, contacts: Tensor) -> Tensor:
    """How unlikely it is that soles move by (..., 3) from one frame to the next, where contacts (...) are 1."""
    squares = (moved_m / _PLANTED_M).square().sum(dim=-1)
    return (contacts * squares / (1.0 + squares / _ROBUST**2)).sum()
