"""Levels of detail of an avatar: a tree of chunks in its canonical pose.

Only Gaussians that much the same joints move are merged; a merged one has their mean weights. Where those differ by at
most `SKIN_TOLERANCE`, its posed mean is off by less than an eighth of the distance between them.
"""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, Int64Array
from readygo.common.rasterizer.lod.tree import ChunkTree, Node, children_of, grow, preorder, tree_of_nodes
from readygo.common.rasterizer.packed.avatar import JOINTS, PackedAvatar, chunk_weights
from readygo.common.rasterizer.packed.scene import CHUNK, rounded_up

TOLERANCE = 0.01
"""Below that of scenes: humans move, and a node of theirs that changes its level would be noticed."""
LEAST_WEIGHT = 1e-3
"""Smaller weights of merged Gaussians are dropped: they would make most blocks depend on many joints."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AvatarTree:
    """An avatar of all levels, each node before its children (preorder); see `ChunkTree`."""

    avatar: PackedAvatar
    """The nodes' Gaussians; boxes hold those of all nodes below, too."""
    skip: Int64Array
    """Number of the next node that is not below this one, shape (C,)."""
    pixel_m: Float64Array
    """Smallest size of a pixel for which a node is drawn [m]; 0 for the leaves, shape (C,)."""


def build_avatar_tree(packed: PackedAvatar) -> AvatarTree:
    """The tree above a packed avatar; takes some seconds."""
    weights = chunk_weights(packed)
    count = int((packed.scene.geometry[:, :, -1] >= 0).sum())
    roots = grow(packed.scene, weights.reshape(-1, JOINTS)[:count], centred=False, tolerance=TOLERANCE)
    nodes = list(preorder(roots))
    tree = tree_of_nodes(packed.scene, nodes, centred=False)
    node_weights = np.stack([_node_weights(node, weights) for node in nodes]) if nodes else weights
    blocks = node_weights.reshape(-1, 16, JOINTS)
    block, joint = np.nonzero((blocks != 0).any(axis=1))
    low, high = _joint_boxes(packed, nodes, tree)
    box_node, box_joint = np.nonzero(low[:, :, 0] <= high[:, :, 0])
    low, high = low[box_node, box_joint], high[box_node, box_joint]
    centre = (0.5 * (low + high)).astype(np.float32)
    avatar = PackedAvatar(
        scene=tree.scene,
        joint_start=np.searchsorted(block, np.arange(len(blocks) + 1)).astype(np.int64),
        joint=joint.astype(np.int64),
        weight=np.ascontiguousarray(blocks[block, :, joint]),
        box_start=np.searchsorted(box_node, np.arange(len(nodes) + 1)).astype(np.int64),
        box_joint=box_joint.astype(np.int64),
        box_centre_m=centre,
        box_half_m=rounded_up(np.maximum(high - centre, centre - low)),
    )
    return AvatarTree(avatar=avatar, skip=tree.skip, pixel_m=tree.pixel_m)


def _node_weights(node: Node, chunk_weights: Float32Array) -> Float32Array:
    """Weights of a node's Gaussians, shape (256, 24)."""
    if node.skin is None:
        leaf: Float32Array = chunk_weights[node.chunk]
        return leaf
    kept = np.where(node.skin < LEAST_WEIGHT, np.float32(0.0), node.skin)
    padded = np.zeros((CHUNK, JOINTS), dtype=np.float32)
    padded[: node.count] = kept / kept.sum(axis=1, keepdims=True)
    return padded


def _joint_boxes(packed: PackedAvatar, nodes: list[Node], tree: ChunkTree) -> tuple[Float64Array, Float64Array]:
    """Bounds, per node and joint, of those means of the node and of all nodes below that the joint moves."""
    low, high = np.full((len(nodes), JOINTS, 3), np.inf), np.full((len(nodes), JOINTS, 3), -np.inf)
    for k in range(len(nodes) - 1, -1, -1):
        node = nodes[k]
        if node.rows is None or node.skin is None:
            boxes = slice(packed.box_start[node.chunk], packed.box_start[node.chunk + 1])
            joints, centre, half = packed.box_joint[boxes], packed.box_centre_m[boxes], packed.box_half_m[boxes]
            low[k, joints], high[k, joints] = centre.astype(np.float64) - half, centre.astype(np.float64) + half
            continue
        means = node.rows[:, None, :3]
        moved = (node.skin >= LEAST_WEIGHT)[..., None]
        below = list(children_of(k, tree.skip))
        low[k] = np.minimum(np.where(moved, means, np.inf).min(axis=0), low[below].min(axis=0))
        high[k] = np.maximum(np.where(moved, means, -np.inf).max(axis=0), high[below].max(axis=0))
    return low, high
