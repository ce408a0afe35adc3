"""Levels of detail: a tree of chunks of which every view draws a cut.

The leaves are the chunks of a packed cloud, in their order. Every other node has up to 256 Gaussians, merged from those
of its children for one size of a pixel, and is a chunk as well. A view draws the coarsest nodes that were merged for
pixels no larger than its own are there (`lod_cull`), so every Gaussian of the cloud is stood for exactly once, without
gaps or overlaps between levels, and nodes change one by one as the camera moves.

A tree is a function of the packed cloud alone. Sums are made in order, logarithms and exponentials one by one.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.rasterizer.constants import ALPHA_MIN
from readygo.common.rasterizer.lod.clusters import (
    Clusters,
    Originals,
    gather_colours,
    gather_normals,
    gather_region,
    make_clusters,
    opacity_of_cover,
)
from readygo.common.rasterizer.lod.cost import MergeRule
from readygo.common.rasterizer.lod.merge import merge_regions
from readygo.common.rasterizer.packed.scene import BLOCKS, CHUNK, GEOMETRY_ROWS, NORMAL_STEP, PackedScene

FIRST_PIXEL_M, LAST_PIXEL_M = 0.004, 300.0
"""Sizes of a pixel of the first level and of the last one that may be made."""
LEVEL_RATIO = math.sqrt(2.0)
TOLERANCE = 0.03
"""Largest cost of a merger: one tenth of a colour's range, squared, at three pixels."""
CONTRAST = 0.1
SKIN_TOLERANCE = 0.5
ROUNDS = 3
DRAWN_AT = 1.2
"""Nodes are made for pixels of this size, relative to the smallest with which they are drawn."""
WORTH_A_NODE = 0.7
"""A node has at most this share of its children's Gaussians."""
WIDEST_PX = 48.0
"""Largest side of the box of a node that joins several regions."""
CROWDED_PX = 8.0
"""Regions whose largest side is smaller are crowded, and may be merged at a higher cost."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChunkTree:
    """Chunks of all levels, each node before its children (preorder)."""

    scene: PackedScene
    """The nodes' Gaussians; boxes and reaches hold those of all nodes below, too."""
    skip: Int64Array
    """Number of the next node that is not below this one, shape (C,)."""
    pixel_m: Float64Array
    """Smallest size of a pixel for which a node is drawn [m]; 0 for the leaves, shape (C,)."""


@dataclass(kw_only=True, eq=False)
class Node:
    """A node while the tree grows."""

    first: int
    """Index of its first Gaussian."""
    end: int
    """Index behind its last Gaussian."""
    count: int
    """Number of Gaussians that stand for these."""
    pixel_m: float = 0.0
    children: "tuple[Node, ...]" = ()
    chunk: int = -1
    """Number of a leaf's chunk."""
    rows: Float64Array | None = None
    """Geometry as in a packed scene, means in the cloud's frame, shape (count, 11)."""
    colour: Float64Array | None = None
    """Rows of packed colours, shape (count, n)."""
    skin: Float32Array | None = None
    """Weights of joints, shape (count, 24) or (count, 0)."""
    normal: Float64Array | None = None
    """Packed normals, shape (count, 3); None for a cloud without."""


def build_tree(scene: PackedScene) -> ChunkTree:
    """The tree above a packed cloud; takes about 30 s per million Gaussians."""
    count = int((scene.geometry[:, :, -1] >= 0).sum())
    return tree_of_nodes(scene, list(preorder(grow(scene, np.zeros((count, 0), dtype=np.float32)))))


def grow(scene: PackedScene, skin: Float32Array, *, centred: bool = True, tolerance: float = TOLERANCE) -> list[Node]:
    """Merge level by level.

    Args:
        scene: A packed cloud whose padding is at its end.
        skin: Weights of joints, shape (N, 24), or (N, 0).
        centred: False if the scene's means are not relative to their chunks' centres.
        tolerance: Largest cost of a merger, see `cost`.

    Returns:
        The roots, in order.
    """
    forest = _Forest(scene, skin, centred, tolerance)
    pixel_m = FIRST_PIXEL_M
    while forest.count_total > CHUNK // 8 and pixel_m <= LAST_PIXEL_M:
        forest.coarsen(pixel_m)
        pixel_m *= LEVEL_RATIO
    return forest.nodes


class _Forest:
    """The regions of one level and the nodes that stand for them."""

    def __init__(self, scene: PackedScene, skin: Float32Array, centred: bool, tolerance: float) -> None:
        self._tolerance = tolerance
        self._originals = _originals(scene, skin, centred)
        count = len(skin)
        self._packed_colours = _plain(scene.colour if len(scene.colour) else scene.sh)
        self._packed_normals = None if scene.normal is None else _plain(scene.normal)
        self._colour_rows = 3 * (1 if len(scene.colour) else scene.sh.shape[3])
        self._first = np.minimum(np.arange(scene.chunk_count + 1) * CHUNK, count)
        self._count = np.diff(self._first)
        self._label: Int32Array = (np.arange(count) % CHUNK).astype(np.int32)
        self._wait = np.zeros(count, dtype=np.int64)
        self._low, self._high = _boxes(self._originals.mean_m, self._first)
        self._clusters = make_clusters(skin.shape[1])
        self.nodes = [
            Node(first=int(self._first[k]), end=int(self._first[k + 1]), count=int(self._count[k]), chunk=k)
            for k in range(scene.chunk_count)
        ]

    @property
    def count_total(self) -> int:
        """Gaussians of this level."""
        return int(self._count.sum())

    def coarsen(self, pixel_m: float) -> None:
        """Merge the Gaussians further, into the level whose pixels have the size `pixel_m` [m]."""
        rule = MergeRule(pixel_m, self._tolerance, CONTRAST, SKIN_TOLERANCE)
        side_px = (self._high - self._low).max(axis=1, initial=0.0) / pixel_m
        leeway = np.maximum((CROWDED_PX / np.maximum(side_px, 1e-3)) ** 2, 1.0)
        regions = (self._label, self._first, self._count, self._wait, leeway)
        merge_regions(self._originals, *regions, rule, ROUNDS, self._clusters)
        runs = list(self._runs(pixel_m))
        counts = [int(self._count[begin:end].sum()) for begin, end in runs]
        self.nodes = [self._node(begin, end, count, pixel_m) for (begin, end), count in zip(runs, counts, strict=True)]
        starts = [begin for begin, _ in runs]
        self._first = np.append(self._first[starts], self._first[-1])
        self._count = np.array(counts, dtype=np.int64)
        self._low = np.minimum.reduceat(self._low, starts)
        self._high = np.maximum.reduceat(self._high, starts)

    def _runs(self, pixel_m: float) -> Iterator[tuple[int, int]]:
        """Neighbouring regions that shall have one node, as many as fit."""
        begin, regions = 0, len(self.nodes)
        while begin < regions:
            end, count, drawn = begin + 1, int(self._count[begin]), self.nodes[begin].count
            low, high = self._low[begin], self._high[begin]
            while end < regions:
                count, drawn = count + int(self._count[end]), drawn + self.nodes[end].count
                low, high = np.minimum(low, self._low[end]), np.maximum(high, self._high[end])
                too_wide = (high - low).max() > WIDEST_PX * pixel_m
                if count > CHUNK or count > WORTH_A_NODE * drawn or too_wide:
                    break
                end += 1
            yield begin, end
            begin = end

    def _node(self, begin: int, end: int, count: int, pixel_m: float) -> Node:
        """The node of some regions: the one they had, unless there are several or it has become too fine."""
        old = self.nodes[begin]
        if end == begin + 1 and count > WORTH_A_NODE * old.count:
            return old
        first, last = int(self._first[begin]), int(self._first[end])
        for region in range(begin + 1, end):
            here = slice(self._first[region], self._first[region + 1])
            self._label[here] += np.int32(self._count[begin:region].sum())
        if end > begin + 1:
            self._wait[first:last] = 0
        node = Node(first=first, end=last, count=count, pixel_m=pixel_m, children=tuple(self.nodes[begin:end]))
        self._fill(node, pixel_m * DRAWN_AT)
        return node

    def _fill(self, node: Node, pixel_m: float) -> None:
        clusters, span = self._clusters, (node.first, node.end)
        gather_region(self._originals, self._label, *span, node.count, pixel_m, clusters)
        node.colour = np.empty((node.count, self._colour_rows))
        gather_colours(self._originals, self._label, *span, pixel_m, self._packed_colours, clusters.weight, node.colour)
        if self._packed_normals is not None:
            sums = np.empty((node.count, 3))
            gather_normals(self._originals, self._label, *span, pixel_m, self._packed_normals, sums)
            length = np.sqrt(sums[:, 0] * sums[:, 0] + sums[:, 1] * sums[:, 1] + sums[:, 2] * sums[:, 2])
            node.normal = sums / (NORMAL_STEP * np.maximum(length, 1e-30))[:, None]
        node.rows = _geometry_rows(clusters, node.count, self._originals.mean_m[node.first])
        node.skin = clusters.skin[: node.count].astype(np.float32)


def preorder(roots: list[Node]) -> Iterator[Node]:
    """All nodes, each before its children."""
    waiting = roots[::-1]
    while waiting:
        node = waiting.pop()
        yield node
        waiting.extend(node.children[::-1])


def children_of(k: int, skip: Int64Array) -> Iterator[int]:
    """Numbers of the children of node `k`."""
    child = k + 1
    while child < skip[k]:
        yield child
        child = int(skip[child])


def tree_of_nodes(scene: PackedScene, nodes: list[Node], *, centred: bool = True) -> ChunkTree:
    """Pack nodes.

    Args:
        scene: The leaves' cloud.
        nodes: All nodes in preorder.
        centred: Store means relative to their chunk's centre.
    """
    skip = _skips(nodes)
    chunks = [max(node.chunk, 0) for node in nodes]
    centre, half, reach = scene.centre_m[chunks], scene.half_m[chunks], scene.reach_m[chunks]
    geometry, colour, sh = scene.geometry[chunks], scene.colour[chunks if len(scene.colour) else []], scene.sh
    sh = sh[chunks if len(sh) else []]
    normal = None if scene.normal is None else scene.normal[chunks]
    for k in range(len(nodes) - 1, -1, -1):
        node, below = nodes[k], list(children_of(k, skip))
        if node.rows is None or node.colour is None:
            continue
        means = node.rows[:, :3]
        low = np.minimum(means.min(axis=0), (centre[below] - half[below]).min(axis=0))
        high = np.maximum(means.max(axis=0), (centre[below] + half[below]).max(axis=0))
        centre[k] = (0.5 * (low + high)).astype(np.float32)
        half[k] = np.nextafter(np.maximum(high - centre[k], centre[k] - low).astype(np.float32), np.float32(np.inf))
        reach[k] = max(_reach(node.rows), reach[below].max())
        geometry[k] = _blocks(node.rows - np.pad(centre[k] * centred, (0, GEOMETRY_ROWS - 3)), -1.0)
        if normal is not None and node.normal is not None:
            normal[k] = np.rint(_blocks(node.normal, 0.0))
        if len(colour):
            colour[k] = _blocks(node.colour, 0.0)
        else:
            sh[k] = np.rint(_blocks(node.colour, 0.0)).reshape(sh.shape[1:])
    packed = PackedScene(
        centre_m=centre,
        half_m=half,
        reach_m=reach,
        geometry=geometry,
        colour=colour,
        sh=sh,
        sh_step=scene.sh_step,
        normal=normal,
    )
    return ChunkTree(scene=packed, skip=skip, pixel_m=np.array([node.pixel_m for node in nodes]))


def _plain(array: AnyArray) -> AnyArray:
    """A flat view that cannot be written, of one type whether mapped or not, so that kernels compile once."""
    flat = array.view(np.ndarray).reshape(-1)
    flat.flags.writeable = False
    return flat


def _skips(nodes: list[Node]) -> Int64Array:
    skip = np.zeros(len(nodes), dtype=np.int64)
    place = {id(node): k for k, node in enumerate(nodes)}
    for k in range(len(nodes) - 1, -1, -1):
        below = nodes[k].children
        skip[k] = skip[place[id(below[-1])]] if below else k + 1
    return skip


def _originals(scene: PackedScene, skin: Float32Array, centred: bool) -> Originals:
    count = len(skin)
    rows = scene.geometry.transpose(0, 1, 3, 2).reshape(-1, GEOMETRY_ROWS)[:count].astype(np.float64)
    means = rows[:, :3] + np.repeat(scene.centre_m, CHUNK, axis=0)[:count] * centred
    opacity = np.array([math.exp(value) for value in (rows[:, 9] * math.log(2.0)).tolist()], dtype=np.float64)
    return Originals(
        mean_m=means,
        covariance_m2=np.ascontiguousarray(rows[:, 3:9]),
        opacity=opacity,
        colour=_base_colours(scene, count),
        skin=skin,
    )


def _base_colours(scene: PackedScene, count: int) -> Float64Array:
    if len(scene.colour):
        return scene.colour.transpose(0, 1, 3, 2).reshape(-1, 3)[:count].astype(np.float64)
    constant = scene.sh[:, :, :, 0].transpose(0, 1, 3, 2).reshape(-1, 3)[:count]
    colours: Float64Array = np.maximum(0.5 + SH_C0 * float(scene.sh_step[0]) * constant.astype(np.float64), 0.0)
    return colours


def _geometry_rows(clusters: Clusters, count: int, origin_m: Float64Array) -> Float64Array:
    """Packed geometry of merged Gaussians."""
    rows = np.empty((count, GEOMETRY_ROWS))
    log_opacity = np.array([math.log(max(opacity_of_cover(value), 1e-9)) for value in clusters.cover[:count].tolist()])
    rows[:, :3] = clusters.mean_m[:count] + origin_m
    rows[:, 3:9] = clusters.covariance_m2[:count]
    rows[:, 9] = log_opacity / math.log(2.0)
    rows[:, 10] = np.maximum(2.0 * (log_opacity - math.log(ALPHA_MIN)), 0.0)
    return rows


def _reach(rows: Float64Array) -> float:
    """A bound of how far the Gaussians reach from their means [m], by the Frobenius norms of their covariances."""
    xx, xy, xz, yy, yz, zz = rows[:, 3:9].T
    norm = np.sqrt(xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz))
    return 1.0001 * float(np.sqrt(rows[:, 10] * norm).max())


def _blocks(rows: Float64Array, padding: float) -> AnyArray:
    """(n, rows) -> (16 blocks, rows, 16 lanes), filled up with zeros but for the last row."""
    padded = np.zeros((CHUNK, rows.shape[1]))
    padded[len(rows) :, -1] = padding
    padded[: len(rows)] = rows
    return padded.reshape(BLOCKS, 16, -1).transpose(0, 2, 1)


def _boxes(means_m: Float64Array, first: Int64Array) -> tuple[Float64Array, Float64Array]:
    """Bounds of the means of each run."""
    if len(means_m) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    return np.minimum.reduceat(means_m, first[:-1]), np.maximum.reduceat(means_m, first[:-1])
