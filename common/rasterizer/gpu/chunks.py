"""Gaussian clouds in chunks of 256 neighbours, laid out for a GPU: one row of 256 numbers per quantity."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray, BoolArray, Float32Array, Float64Array, Int32Array, Int64Array, UInt8Array
from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud, rgb_of_sh
from readygo.common.rasterizer.constants import ALPHA_MIN
from readygo.common.rasterizer.packed.avatar import (
    JOINTS,
    avatar_normals,
    dense_weights,
    joint_boxes,
    joint_sets,
)
from readygo.common.rasterizer.packed.scene import CHUNK, chunk_rows, morton_codes, pad_chunks, shortest_axes


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
    order = index[np.lexsort((morton_codes(avatar.cloud.means_m[index]), joint_sets(avatar)[index]))]
    joint, weight = avatar.lbs_index[order], avatar.lbs_weight[order]
    worn = dataclasses.replace(avatar, cloud=avatar.cloud.select(order), lbs_index=joint, lbs_weight=weight)
    box_joint, centre, half = _boxes(worn)
    return ChunkedAvatar(
        cloud=_chunks(worn.cloud, centred=False),
        joint=_rows(joint).astype(np.uint8),
        weight=_rows(weight).astype(np.float32),
        shading=_rows(avatar_normals(worn)).astype(np.float32),
        box_joint=box_joint,
        box_centre_m=centre,
        box_half_m=half,
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
    rows = chunk_rows(cloud, centred)
    chunks = len(rows.geometry)
    return ChunkedCloud(
        centre_m=rows.centre_m,
        half_m=rows.half_m,
        reach_m=rows.reach_m,
        geometry=np.ascontiguousarray(rows.geometry.swapaxes(1, 2), dtype=np.float32),
        colour=_rows(rgb_of_sh(cloud.sh[:, 0].astype(np.float64))).astype(np.float32),
        sh=_rows(cloud.sh[:, 1:].reshape(count, 3 * bands)).reshape(chunks, bands, 3, CHUNK).astype(np.float16),
        normal=_rows(shortest_axes(cloud)).astype(np.float32),
    )


def _rows(values: AnyArray) -> Float64Array:
    """Rows (N, n) as chunks (C, n, 256), filled up with zeros."""
    return np.ascontiguousarray(pad_chunks(values).swapaxes(1, 2))


def _boxes(avatar: Avatar) -> tuple[Int32Array, Float32Array, Float32Array]:
    """Boxes around the means of each chunk that each joint moves: joints (C, J), centres and half sizes (C, J, 3)."""
    weights = pad_chunks(dense_weights(avatar)).reshape(-1, JOINTS)
    start, joint, centre, half = joint_boxes(avatar.cloud.means_m.astype(np.float64), weights)
    counts = np.diff(start)
    chunk = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(joint)) - start[chunk]
    shape = len(counts), int(counts.max(initial=1))
    joints, centres, halves = np.full(shape, -1, np.int32), *(np.zeros((*shape, 3), np.float32) for _ in range(2))
    joints[chunk, place], centres[chunk, place], halves[chunk, place] = joint, centre, half
    return joints, centres, halves
