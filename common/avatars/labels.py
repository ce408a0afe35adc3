"""What a data set says about a human in one pose: joints, a box around the body, the ground below it."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.avatars.avatar import Avatar
from readygo.common.avatars.footprint import FootprintModel, footprint_xy
from readygo.common.avatars.kinematics import fill_globals, fill_joint_transforms, posed_point
from readygo.common.kernels import kernel_with_cache
from readygo.common.messages.motion import Motion
from readygo.common.messages.samples import HumanLabels

FOOTPRINT_CELL_M = 0.05
"""One ground point per cell of this size, that of the maps."""
BOX_OPACITY_MIN = 0.5
"""Fainter Gaussians do not widen a box."""
DIRECTIONS = tuple(
    direction
    for direction in itertools.product((-2, -1, 0, 1, 2), repeat=3)
    if sorted(map(abs, direction)) in ([0, 0, 1], [1, 1, 1], [0, 1, 2])
)
"""38 directions, no two neighbours of which are further apart than 35 degrees."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelModel:
    """An avatar as its labels need it: its skeleton, and at most 1,912 points of it."""

    skeleton: Avatar
    """Skeleton of the avatar, without Gaussians."""
    footprint: FootprintModel
    hull: Float64Array
    """Canonical points [m] that are the outermost of some joint's in some direction, shape (P, 3), P <= 912."""
    lbs_index: UInt8Array
    """Joints that move the points of the hull, shape (P, 4)."""
    lbs_weight: Float32Array

    @classmethod
    def from_avatar(cls, avatar: Avatar) -> "LabelModel":
        """Prepare an avatar, once per process."""
        chosen = _outermost(avatar)
        return cls(
            skeleton=avatar.skeleton(),
            footprint=FootprintModel.from_avatar(avatar),
            hull=avatar.cloud.means_m[chosen].astype(np.float64),
            lbs_index=np.ascontiguousarray(avatar.lbs_index[chosen]),
            lbs_weight=np.ascontiguousarray(avatar.lbs_weight[chosen]),
        )


def human_labels(model: LabelModel, motion: Motion, step: int, yaw_rad: float) -> HumanLabels:
    """The labels of a human at one step of a motion.

    Args:
        model: Who.
        motion: How they move; after its last row the pose is held.
        step: Simulation step, 0 or more.
        yaw_rad: Direction in which the human looks and the box lies.
    """
    row = motion.row(step)
    body = model.skeleton
    joints, box = np.empty((24, 3)), np.empty(7)
    _fill_joints_and_box(
        motion.root_m[row].astype(np.float64),
        motion.pose_axis_angle[row].astype(np.float64),
        (body.joints_tpose_m, body.joints_canonical_m, body.R_tpose_canonical),
        (model.hull, model.lbs_index, model.lbs_weight),
        yaw_rad,
        joints,
        box,
    )
    ground = thin_points(footprint_xy(model.footprint, body, motion, step), FOOTPRINT_CELL_M)
    return HumanLabels(joints_m=joints.astype(np.float32), box=box, footprint_xy_m=ground.astype(np.float32))


def thin_points(xy_m: Float64Array, cell_m: float) -> Float64Array:
    """The means of points [m] (N, 2) within the cells of a grid on the world, shape (M, 2), by column and row."""
    out = np.empty_like(xy_m)
    return out[: _fill_thinned(xy_m, cell_m, out)]


def _outermost(avatar: Avatar) -> npt.NDArray[np.intp]:
    """The Gaussians that lie furthest in each direction among those that a joint moves most."""
    solid = np.flatnonzero(avatar.cloud.opacities >= BOX_OPACITY_MIN)
    if len(solid) == 0:
        solid = np.arange(len(avatar.cloud))
    points = avatar.cloud.means_m[solid].astype(np.float64)
    strongest = np.argmax(avatar.lbs_weight[solid], axis=1)
    joint = avatar.lbs_index[solid, strongest]
    chosen: set[int] = set()
    for j in range(24):
        mine = np.flatnonzero(joint == j)
        if len(mine) == 0:
            continue
        p = points[mine]
        for a, b, c in DIRECTIONS:
            chosen.add(int(solid[mine[np.argmax(a * p[:, 0] + b * p[:, 1] + c * p[:, 2])]]))
    return np.array(sorted(chosen), dtype=np.intp)


@kernel_with_cache
def _fill_joints_and_box(
    root: Float64Array,
    pose: Float64Array,
    skeleton: tuple[Float32Array, Float32Array, Float32Array],
    hull: tuple[Float64Array, UInt8Array, Float32Array],
    yaw: float,
    joints: Float64Array,
    box: Float64Array,
) -> None:
    A, rotations = np.empty((24, 3, 4)), np.empty((24, 3, 3))
    fill_globals(root, pose, skeleton[0], rotations, joints)
    fill_joint_transforms(root, pose, skeleton[0], skeleton[1], skeleton[2], A)
    c, s = math.cos(yaw), math.sin(yaw)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    points, lbs_index, lbs_weight = hull
    for n in range(len(points)):
        x, y, z = posed_point(A, points, lbs_index, lbs_weight, n)
        forward, left = c * x + s * y, c * y - s * x
        low[0], high[0] = min(low[0], forward), max(high[0], forward)
        low[1], high[1] = min(low[1], left), max(high[1], left)
        low[2], high[2] = min(low[2], z), max(high[2], z)
    forward, left = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])
    box[0], box[1], box[2] = c * forward - s * left, s * forward + c * left, 0.5 * (low[2] + high[2])
    for k in range(3):
        box[3 + k] = high[k] - low[k]
    box[6] = yaw


@kernel_with_cache
def _fill_thinned(xy: Float64Array, cell: float, out: Float64Array) -> int:
    if len(xy) == 0:
        return 0
    x0, y0 = math.floor(xy[:, 0].min() / cell), math.floor(xy[:, 1].min() / cell)
    x1, y1 = math.floor(xy[:, 0].max() / cell), math.floor(xy[:, 1].max() / cell)
    sums = np.zeros((int(x1 - x0) + 1, int(y1 - y0) + 1, 3))
    for n in range(len(xy)):
        column, row = int(math.floor(xy[n, 0] / cell) - x0), int(math.floor(xy[n, 1] / cell) - y0)
        sums[column, row, 0] += xy[n, 0]
        sums[column, row, 1] += xy[n, 1]
        sums[column, row, 2] += 1.0
    count = 0
    for column in range(sums.shape[0]):
        for row in range(sums.shape[1]):
            if sums[column, row, 2] > 0.0:
                out[count, 0] = sums[column, row, 0] / sums[column, row, 2]
                out[count, 1] = sums[column, row, 1] / sums[column, row, 2]
                count += 1
    return count
