"""What a map of the robot's surroundings sees of a human: ground points of a thinned, posed avatar."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float32Array, Float64Array, Int64Array, UInt8Array
from readygo.common.avatars.avatar import Avatar
from readygo.common.avatars.kinematics import fill_joint_transforms, posed_point
from readygo.common.kernels import kernel_with_cache
from readygo.common.messages.checks import check_array
from readygo.common.messages.motion import Motion

_TRACE_PERCENTILE = 75.0


@dataclass(frozen=True, kw_only=True, eq=False)
class FootprintModel:
    """An avatar's solid parts as a few points in the canonical pose, each bound to the skeleton."""

    points_m: Float64Array
    """Canonical positions [m], SMPL axes, shape (P, 3)."""
    weights: Float64Array
    """Opacity that each point stands for, shape (P,)."""
    lbs_index: UInt8Array
    lbs_weight: Float32Array

    def __post_init__(self) -> None:
        check_array("points_m", self.points_m, np.float64, (None, 3))
        count = len(self.points_m)
        check_array("weights", self.weights, np.float64, (count,))
        check_array("lbs_index", self.lbs_index, np.uint8, (count, 4))
        check_array("lbs_weight", self.lbs_weight, np.float32, (count, 4))

    @classmethod
    def from_avatar(cls, avatar: Avatar, *, voxel_m: float = 0.05, point_limit: int = 1000) -> "FootprintModel":
        """Thin out an avatar, once per avatar.

        The quarter of the Gaussians with the largest covariance trace is dropped (blurry hulls widen a human),
        the rest becomes one point per voxel: the Gaussian nearest to the voxel's mean.

        Args:
            avatar: Who.
            voxel_m: Edge of a voxel [m]; grows by tenths until the limit holds.
            point_limit: Most points to keep.

        Raises:
            ValueError: If `voxel_m` or `point_limit` is not positive.
        """
        if not voxel_m > 0 or point_limit < 1:
            raise ValueError(f"voxel_m and point_limit must be positive, got {voxel_m} and {point_limit}.")
        kept = _solid(avatar)
        points = avatar.cloud.means_m[kept].astype(np.float64)
        voxels = _voxel_of(points, voxel_m)
        while int(voxels.max()) >= point_limit:
            voxel_m *= 1.1
            voxels = _voxel_of(points, voxel_m)
        weights, chosen = _representatives(points, avatar.cloud.opacities[kept].astype(np.float64), voxels)
        index = kept[chosen]
        return cls(
            points_m=np.ascontiguousarray(points[chosen]),
            weights=weights,
            lbs_index=np.ascontiguousarray(avatar.lbs_index[index]),
            lbs_weight=np.ascontiguousarray(avatar.lbs_weight[index]),
        )


def footprint_xy(
    model: FootprintModel, avatar: Avatar, motion: Motion, step: int, *, z_max_m: float = math.inf
) -> Float64Array:
    """Ground points of a human at one step of a motion.

    Args:
        model: The avatar's footprint model.
        avatar: Whose skeleton.
        motion: How they move; after its last row the pose is held.
        step: Simulation step, 0 or more.
        z_max_m: Points above this world height are left out [m]; pass the floor plus the robot's height and a margin
            for what can touch the robot.

    Returns:
        World x, y [m], shape (P', 2), in the model's order; not empty unless `z_max_m` cuts everything.
    """
    row = motion.row(step)
    out = np.empty((len(model.points_m), 2))
    count = _fill_footprint(
        motion.root_m[row].astype(np.float64),
        motion.pose_axis_angle[row].astype(np.float64),
        avatar.joints_tpose_m,
        avatar.joints_canonical_m,
        avatar.R_tpose_canonical,
        model.points_m,
        model.lbs_index,
        model.lbs_weight,
        float(z_max_m),
        out,
    )
    return out[:count]


def _solid(avatar: Avatar) -> npt.NDArray[np.intp]:
    scales = avatar.cloud.scales_m.astype(np.float64)
    trace = scales[:, 0] * scales[:, 0] + scales[:, 1] * scales[:, 1] + scales[:, 2] * scales[:, 2]
    return np.flatnonzero(trace <= np.percentile(trace, _TRACE_PERCENTILE))


def _voxel_of(points: Float64Array, voxel_m: float) -> Int64Array:
    """Number of each point's voxel; voxels are numbered in the order of their x, y, z cells."""
    cells = np.floor(points / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    sizes = cells.max(axis=0) + 1
    flat = (cells[:, 0] * sizes[1] + cells[:, 1]) * sizes[2] + cells[:, 2]
    return np.unique(flat, return_inverse=True)[1].astype(np.int64)


def _representatives(
    points: Float64Array, opacities: Float64Array, voxels: Int64Array
) -> tuple[Float64Array, npt.NDArray[np.intp]]:
    """Opacity sum of each voxel, and the index of the point nearest to its opacity-weighted mean."""
    weights: Float64Array = np.bincount(voxels, weights=opacities).astype(np.float64)
    safe = np.maximum(weights, 1e-12)
    means = np.stack([np.bincount(voxels, weights=opacities * points[:, k]) / safe for k in range(3)], axis=1)
    offset = points - means[voxels]
    distance = offset[:, 0] * offset[:, 0] + offset[:, 1] * offset[:, 1] + offset[:, 2] * offset[:, 2]
    order = np.lexsort((distance, voxels))
    first = np.flatnonzero(np.diff(voxels[order], prepend=-1))
    return weights, order[first]


@kernel_with_cache
def _fill_footprint(
    root: Float64Array,
    pose: Float64Array,
    joints_tpose: Float32Array,
    joints_canonical: Float32Array,
    R_tpose_canonical: Float32Array,
    points: Float64Array,
    lbs_index: UInt8Array,
    lbs_weight: Float32Array,
    z_max: float,
    out: Float64Array,
) -> int:
    A = np.empty((24, 3, 4))
    fill_joint_transforms(root, pose, joints_tpose, joints_canonical, R_tpose_canonical, A)
    count = 0
    for n in range(len(points)):
        x, y, z = posed_point(A, points, lbs_index, lbs_weight, n)
        if z <= z_max:
            out[count, 0] = x
            out[count, 1] = y
            count += 1
    return count
