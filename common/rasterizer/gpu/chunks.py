"""Gaussian clouds in chunks of 256 neighbours, laid out for a GPU: one row of 256 numbers per quantity."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import (
    BoolArray,
    Float32Array,
    Float64Array,
    FloatingArray,
    Int32Array,
    Int64Array,
    UInt8Array,
)
from readygo.common.avatars import Avatar
from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians import GaussianCloud, rgb_of_sh
from readygo.common.rasterizer.constants import ALPHA_MIN
from readygo.common.rasterizer.packed.avatar import avatar_normals
from readygo.common.rasterizer.packed.scene import (
    CHUNK,
    chunk_boxes,
    covariances,
    morton_codes,
    opacity_terms,
    rounded_up,
)

GEOMETRY_ROWS = 11
"""Mean (3), covariance xx xy xz yy yz zz (6), log2 opacity, squared reach in sigmas (negative: padding)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChunkedCloud:
    """C chunks of up to 256 Gaussians that lie close together."""

    centre_m: Float64Array
    """Centre of each chunk's means [m], shape (C, 3)."""
    half_m: Float32Array
    """Half sizes of the box around a chunk's means [m], shape (C, 3)."""
    reach_m: Float32Array
    """Largest distance from its mean at which a Gaussian of the chunk has alpha 1/255 [m], shape (C,)."""
    geometry: Float32Array
    """The rows of `GEOMETRY_ROWS`, shape (C, 11, 256)."""
    colour: Float32Array
    """Colour of degree 0, not clamped, shape (C, 3, 256)."""
    sh: npt.NDArray[np.float16]
    """Coefficients above degree 0, shape (C, K - 1, 3, 256)."""
    normal: Float32Array
    """Shortest axis of each Gaussian, in the frame of its covariance, shape (C, 3, 256)."""

    @property
    def chunk_count(self) -> int:
        """Number of chunks, C."""
        return len(self.centre_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class ChunkedAvatar:
    """An avatar in canonical coordinates, sorted by the joints that move its Gaussians."""

    cloud: ChunkedCloud
    """Gaussians; means relative to the origin, not to their chunk's centre."""
    joint: UInt8Array
    """Joints that move each Gaussian, shape (C, 4, 256)."""
    weight: Float32Array
    """Skinning weights of these joints, shape (C, 4, 256)."""
    shading: Float32Array
    """Normals that light falls on, shape (C, 3, 256)."""
    box_joint: Int32Array
    """Joint that carries each box of a chunk, -1: no box, shape (C, J)."""
    box_centre_m: Float32Array
    """Centres of the boxes around those means of the chunk that the joint moves [m], shape (C, J, 3)."""
    box_half_m: Float32Array
    """Half sizes of these boxes [m], shape (C, J, 3)."""


def morton_order(cloud: GaussianCloud) -> Int64Array:
    """Indices of the Gaussians that can be drawn, neighbours together.

    Left out are those that never reach alpha 1/255 and those with a number that is not finite or a quaternion of
    length 0.
    """
    index = np.flatnonzero(_drawable(cloud))
    order: Int64Array = index[np.argsort(morton_codes(cloud.means_m[index]), kind="stable")]
    return order


def chunk_cloud(cloud: GaussianCloud) -> ChunkedCloud:
    """Chunks of a static cloud, means relative to their chunk's centre."""
    return _chunks(cloud.select(morton_order(cloud)), centred=True)


def chunk_avatar(avatar: Avatar) -> ChunkedAvatar:
    """Chunks of an avatar, so that few joints move each chunk."""
    index = np.flatnonzero(_drawable(avatar.cloud))
    joints = np.bitwise_or.reduce(
        np.where(avatar.lbs_weight != 0, np.int64(1) << avatar.lbs_index.astype(np.int64), 0), axis=1
    )
    order = index[np.lexsort((morton_codes(avatar.cloud.means_m[index]), joints[index]))]
    joint, weight = avatar.lbs_index[order], avatar.lbs_weight[order]
    worn = dataclasses.replace(avatar, cloud=avatar.cloud.select(order), lbs_index=joint, lbs_weight=weight)
    cloud = _chunks(worn.cloud, centred=False)
    box_joint, centre, half = _joint_boxes(avatar.cloud.means_m[order].astype(np.float64), joint, weight)
    return ChunkedAvatar(
        cloud=cloud,
        joint=_rows(joint).astype(np.uint8),
        weight=_rows(weight).astype(np.float32),
        shading=_rows(avatar_normals(worn)).astype(np.float32),
        box_joint=box_joint,
        box_centre_m=centre.astype(np.float32),
        box_half_m=rounded_up(half),
    )


def _drawable(cloud: GaussianCloud) -> BoolArray:
    finite = cloud.opacities >= np.float32(ALPHA_MIN)
    for array in (cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.sh):
        finite &= np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    drawable: BoolArray = finite & (cloud.quats_wxyz != 0).any(axis=1)
    return drawable


def _chunks(cloud: GaussianCloud, *, centred: bool) -> ChunkedCloud:
    """Chunks of a cloud in its order."""
    count, bands = len(cloud), cloud.sh.shape[1] - 1
    chunks = -(-count // CHUNK)
    valid = np.arange(chunks * CHUNK).reshape(chunks, CHUNK) < count
    means = _pad_chunks(cloud.means_m.astype(np.float64))
    centre, half = chunk_boxes(means, valid)
    log2_opacity, reach2 = opacity_terms(cloud.opacities)
    reach = np.sqrt(reach2) * cloud.scales_m.max(axis=1, initial=0.0)
    rows = np.concatenate(
        [
            means - centre[:, None] if centred else means,
            _pad_chunks(covariances(cloud)),
            _pad_chunks(log2_opacity[:, None]),
            _pad_chunks(reach2[:, None]),
        ],
        axis=2,
    )
    rows[~valid, -1] = -1.0
    return ChunkedCloud(
        centre_m=centre,
        half_m=rounded_up(half),
        reach_m=rounded_up(_pad_chunks(reach[:, None].astype(np.float64))[..., 0].max(axis=1)),
        geometry=np.ascontiguousarray(rows.swapaxes(1, 2), dtype=np.float32),
        colour=_rows(rgb_of_sh(cloud.sh[:, 0].astype(np.float64))).astype(np.float32),
        sh=_rows(cloud.sh[:, 1:].reshape(count, 3 * bands)).reshape(chunks, bands, 3, CHUNK).astype(np.float16),
        normal=_rows(_shortest_axes(cloud)).astype(np.float32),
    )


def _pad_chunks(values: FloatingArray) -> Float64Array:
    """Rows (N, n) in chunks (C, 256, n), filled up with zeros."""
    chunks = -(-len(values) // CHUNK)
    padded = np.zeros((chunks * CHUNK, values.shape[1]))
    padded[: len(values)] = values
    return padded.reshape(chunks, CHUNK, values.shape[1])


def _rows(values: npt.NDArray[np.generic]) -> Float64Array:
    """Rows (N, n) as chunks (C, n, 256), filled up with zeros."""
    chunks = -(-len(values) // CHUNK)
    padded = np.zeros((chunks * CHUNK, values.shape[1]))
    padded[: len(values)] = values
    return np.ascontiguousarray(padded.reshape(chunks, CHUNK, values.shape[1]).swapaxes(1, 2))


def _shortest_axes(cloud: GaussianCloud) -> Float64Array:
    """Unit vectors along the axis with the smallest scale, the first one of equals, shape (N, 3)."""
    q = cloud.quats_wxyz.astype(np.float64)
    R = matrix_from_quat(q / np.linalg.norm(q, axis=1, keepdims=True))
    shortest = cloud.scales_m.argmin(axis=1) if len(cloud) else np.zeros(0, dtype=np.int64)
    return np.take_along_axis(R, shortest[:, None, None], axis=2)[..., 0]


def _joint_boxes(
    means_m: Float64Array, joint: UInt8Array, weight: Float32Array
) -> tuple[Int32Array, Float64Array, Float64Array]:
    """Boxes around the means of each chunk that each joint moves: joints (C, J), centres and half sizes (C, J, 3)."""
    chunks = -(-len(means_m) // CHUNK)
    movers = np.zeros((chunks * CHUNK, 24), dtype=np.bool_)
    for k in range(4):
        movers[np.arange(len(means_m)), joint[:, k]] |= weight[:, k] != 0
    moved = movers.reshape(chunks, CHUNK, 24)
    chunk, mover = np.nonzero(moved.any(axis=1))
    place = np.arange(len(chunk)) - np.searchsorted(chunk, chunk)
    boxes = int(place.max(initial=0)) + 1
    box_joint = np.full((chunks, boxes), -1, dtype=np.int32)
    centre, half = np.zeros((chunks, boxes, 3)), np.zeros((chunks, boxes, 3))
    box_joint[chunk, place] = mover
    centre[chunk, place], half[chunk, place] = chunk_boxes(_pad_chunks(means_m)[chunk], moved[chunk, :, mover])
    return box_joint, centre, half
