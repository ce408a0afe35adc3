"""Avatars packed for the CPU rasterizer: blocks of 16 Gaussians that the same few joints move."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array, Float64Array, Int16Array, Int64Array
from readygo.common.avatars import Avatar
from readygo.common.avatars.shading import outward_normals
from readygo.common.rasterizer.constants import ALPHA_MIN
from readygo.common.rasterizer.packed.scene import (
    BLOCKS,
    CHUNK,
    COV_XX,
    COV_ZZ,
    MEAN_X,
    MEAN_Z,
    NORMAL_STEP,
    PackedScene,
    chunk_boxes,
    covariances,
    flatness,
    morton_codes,
    pack_sorted,
    pad_chunks,
    rounded_up,
    shortest_axes,
)

JOINTS = 24


@dataclass(frozen=True, kw_only=True, eq=False)
class PackedAvatar:
    """An avatar's Gaussians in canonical coordinates, sorted by the joints that move them.

    A block's blended transform is the sum over its joints of a weight per lane times the joint's matrix, which costs a
    broadcast and a multiply-add per matrix entry and joint.
    """

    scene: PackedScene
    """Gaussians; means relative to the origin, not to their chunk's centre."""
    joint_start: Int64Array
    """First joint of each block in `joint` and `weight`, shape (16 C + 1,)."""
    joint: Int64Array
    """Joints of all blocks, shape (J,)."""
    weight: Float32Array
    """Weights of those joints for the block's 16 Gaussians, shape (J, 16)."""
    box_start: Int64Array
    """First box of each chunk, shape (C + 1,)."""
    box_joint: Int64Array
    """Joint that carries each box, shape (B,)."""
    box_centre_m: Float32Array
    """Centres of the boxes around those means of the chunk that the joint moves [m], shape (B, 3)."""
    box_half_m: Float32Array
    """Their half sizes [m], shape (B, 3)."""


def pack_avatar(avatar: Avatar) -> PackedAvatar:
    """Pack an avatar; Gaussians that never reach alpha 1/255 are left out."""
    index = np.flatnonzero(avatar.cloud.opacities >= np.float32(ALPHA_MIN))
    order = index[np.lexsort((morton_codes(avatar.cloud.means_m[index]), joint_sets(avatar)[index]))]
    weights = dense_weights(avatar)[order]
    scene = pack_sorted(avatar.cloud.select(order), centred=False, normals=True)
    padded = np.zeros((scene.chunk_count * CHUNK, JOINTS), dtype=np.float32)
    padded[: len(weights)] = weights
    # Per block of 16 the joints that move any of its Gaussians, in ascending order.
    blocks = padded.reshape(-1, 16, JOINTS)
    block_index, joint = np.nonzero((blocks != 0).any(axis=1))
    box_start, box_joint, centre, half = joint_boxes(avatar.cloud.means_m[order].astype(np.float64), padded)
    return PackedAvatar(
        scene=scene,
        joint_start=np.searchsorted(block_index, np.arange(len(blocks) + 1)).astype(np.int64),
        joint=joint.astype(np.int64),
        weight=np.ascontiguousarray(blocks[block_index, :, joint]),
        box_start=box_start,
        box_joint=box_joint,
        box_centre_m=centre,
        box_half_m=half,
    )


def chunk_weights(packed: PackedAvatar) -> Float32Array:
    """Weights of all joints, shape (C, 256, 24)."""
    blocks = packed.scene.chunk_count * BLOCKS
    dense = np.zeros((blocks, JOINTS, 16), dtype=np.float32)
    dense[np.repeat(np.arange(blocks), np.diff(packed.joint_start)), packed.joint] = packed.weight
    return np.ascontiguousarray(dense.transpose(0, 2, 1)).reshape(-1, CHUNK, JOINTS)


def packed_shading(packed: PackedAvatar, joints_m: Float32Array) -> Int16Array:
    """Normals that light falls on, in steps of `NORMAL_STEP`, shape (C, 16, 3, 16); see `avatars.shading`.

    Args:
        packed: The avatar.
        joints_m: Its joints in the canonical pose [m], shape (24, 3).
    """
    scene = packed.scene
    assert scene.normal is not None
    # One row of numbers per Gaussian again.
    rows = scene.geometry.astype(np.float64).transpose(0, 1, 3, 2).reshape(-1, scene.geometry.shape[2])
    axes = scene.normal.transpose(0, 1, 3, 2).reshape(-1, 3).astype(np.float64) * NORMAL_STEP
    weights = chunk_weights(packed).reshape(-1, JOINTS)
    normals = outward_normals(
        rows[:, MEAN_X : MEAN_Z + 1], axes, flatness(rows[:, COV_XX : COV_ZZ + 1], axes), weights, joints_m
    )
    steps = np.rint(normals / NORMAL_STEP).astype(np.int16)
    return np.ascontiguousarray(steps.reshape(-1, BLOCKS, 16, 3).transpose(0, 1, 3, 2))


def avatar_normals(avatar: Avatar) -> Float64Array:
    """The normals of an avatar's Gaussians in its canonical pose that light falls on, shape (N, 3)."""
    axes = shortest_axes(avatar.cloud)
    flat = flatness(covariances(avatar.cloud), axes)
    means = avatar.cloud.means_m.astype(np.float64)
    return outward_normals(means, axes, flat, dense_weights(avatar), avatar.joints_canonical_m)


def joint_sets(avatar: Avatar) -> Int64Array:
    """Bit set of the joints that move each Gaussian, shape (N,)."""
    bits = np.where(avatar.lbs_weight != 0, np.int64(1) << avatar.lbs_index.astype(np.int64), 0)
    joints: Int64Array = np.bitwise_or.reduce(bits, axis=1)
    return joints


def dense_weights(avatar: Avatar) -> Float32Array:
    """Weight of every joint, shape (N, 24)."""
    dense = np.zeros((len(avatar.cloud), JOINTS), dtype=np.float32)
    rows = np.arange(len(dense))
    for k in range(4):
        dense[rows, avatar.lbs_index[:, k]] += avatar.lbs_weight[:, k]
    return dense


def joint_boxes(means_m: Float64Array, weights: AnyArray) -> tuple[Int64Array, Int64Array, Float32Array, Float32Array]:
    """Boxes around the means of each chunk that each joint moves: starts per chunk, joints, centres, half sizes.

    Args:
        means_m: Means [m], shape (N, 3).
        weights: Weights of all joints, the last chunk filled up with zeros, shape (256 C, 24).
    """
    chunks = len(weights) // CHUNK
    moved = (weights != 0).reshape(chunks, CHUNK, JOINTS)
    chunk, joint = np.nonzero(moved.any(axis=1))
    centre, half = chunk_boxes(pad_chunks(means_m)[chunk], moved[chunk, :, joint])
    start = np.searchsorted(chunk, np.arange(chunks + 1)).astype(np.int64)
    return start, joint.astype(np.int64), centre.astype(np.float32), rounded_up(half)
