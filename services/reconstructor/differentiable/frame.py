"""One view, forward and backward, on NumPy arrays."""

import math
import threading
import weakref
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, Int64Array
from readygo.common.rasterizer.cpu.slabs import Slab, slabs_of
from readygo.common.rasterizer.cpu.view import PinholeView
from readygo.common.rasterizer.cpu.workspace import (
    KEYS,
    LARGE_ENTRIES,
    MAX_SIDE_PX,
    RECORDS,
    TILE,
    Workspace,
    make_workspace,
    tile_count,
    with_room,
)
from readygo.services.reconstructor.differentiable.blend import begin_planes, blend, gather_features
from readygo.services.reconstructor.differentiable.blend_gradients import STATE_ROWS, begin_replay, blend_gradients
from readygo.services.reconstructor.differentiable.cull import bound_chunks
from readygo.services.reconstructor.differentiable.memory import (
    CHUNK,
    FEATURE_GROUP,
    FEATURES,
    GROUP,
    PLANES,
    Chunks,
    Cloud,
    ForwardMemory,
    Gradients,
    Raster,
    allocate_aligned,
)
from readygo.services.reconstructor.differentiable.pool import ArrayPool
from readygo.services.reconstructor.differentiable.project import list_drawn, project
from readygo.services.reconstructor.differentiable.project_gradients import gather_sums, project_gradients

LN_2 = 0.6931471805599453
SLAB_SHARES = (0.15, 0.35, 0.6, 0.8)
"""Fewer slabs than images alone are drawn in: what each of them costs is paid again in the backward pass."""
_FREE_FRAMES = 4


class _Memory(threading.local):
    """What a thread uses again."""

    def __init__(self) -> None:
        self.pool = ArrayPool()
        self.frames: list[Frame] = []


_MEMORY = _Memory()


def zeros(name: str, shape: tuple[int, ...]) -> Float32Array:
    """Zeros in memory that is used again when they are dropped."""
    array: Float32Array = _MEMORY.pool.take(name, math.prod(shape), np.float32)
    array.fill(0.0)
    return array.reshape(shape)


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameGradients:
    """Derivatives of the loss by parameters of m Gaussians, and by n projected means: those of `Drawn.index`."""

    index: Int64Array
    """The Gaussians that have weight in the image, ascending, shape (m,)."""
    means_m: Float32Array
    quats_wxyz: Float32Array
    scales_m: Float32Array
    opacities: Float32Array
    sh: Float32Array | None
    """All Gaussians' rows if they were asked for, shape (m or N, K, 3)."""
    features: Float32Array | None
    R_CW: Float64Array
    """Derivative by the rotation from world to camera, shape (3, 3)."""
    p_WC: Float64Array
    """Derivative by the camera's centre in the world, shape (3,)."""
    means_px: Float32Array
    """Derivatives by the projected means, shape (n, 2)."""
    absolute_px: Float32Array | None
    """Sums of the pixels' absolute derivatives by the projected means, shape (n, 2)."""
    weights: Float32Array
    """Sums of weights over all pixels, shape (n,)."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """What a view looks like."""

    planes: Float32Array
    """Image planes in the order of `memory.PLANES`; sides are multiples of 16 px, features of `FEATURE_GROUP`."""
    token: Float32Array
    """The frame stays in use while this lives."""
    index: Int64Array
    """Gaussians of the groups, ascending, shape (n,)."""
    radius_px: Float32Array
    """The larger half side of the box outside of which their alpha is below the threshold; 0: not drawn, shape (n,)."""


class Frame:
    """Memory of one view from its forward to its backward pass.

    Chunks are drawn in a few slabs of depth, nearest first, so that what lies behind finished pixels is neither
    projected nor sorted; lists of tiles are kept per slab.
    """

    def __init__(self, height_px: int, width_px: int) -> None:
        if max(height_px, width_px) > MAX_SIDE_PX:
            raise ValueError(f"images are limited to {MAX_SIDE_PX} px a side, got {height_px}x{width_px} px.")
        self.size_px = (height_px, width_px)
        self._ws = make_workspace(height_px, width_px)
        self._kept = ForwardMemory(
            groups=np.empty(0, dtype=np.float32),
            lanes=np.empty(0, dtype=np.int32),
            waiting=np.zeros(CHUNK, dtype=np.int64),
            rows=np.zeros(16 * 48, dtype=np.float32),
            coefficients=np.zeros(48 * 16, dtype=np.float32),
        )
        self._chunk_room = _chunk_arrays(0)
        self._bounds = allocate_aligned(5 * 16, np.float32)
        self._raster = Raster(
            planes=np.empty(0, dtype=np.float32),
            height=-(-height_px // TILE) * TILE,
            stride=-(-width_px // TILE) * TILE,
            features=np.empty(0, dtype=np.float32),
            feature_count=0,
            tile_nodes=np.zeros(tile_count(height_px, width_px), dtype=np.int32),
            entry_drawn=np.empty(0, dtype=np.uint16),
            weights=allocate_aligned(64 * 16, np.float32),
            state=allocate_aligned(16 * STATE_ROWS * 16, np.float32),
            block_x=np.tile(np.arange(0, 16, 4, dtype=np.float32), 4),
            block_y=np.repeat(np.arange(0, 16, 4, dtype=np.float32), 4),
        )
        self._slabs: list[_SlabLists] = []
        self._slab_count = 0
        self._token: Callable[[], Float32Array | None] = lambda: None

    @property
    def in_use(self) -> bool:
        """True while the token of the last `draw` lives."""
        return self._token() is not None

    def draw(self, view: PinholeView, cloud: Cloud, features: Float32Array | None, *, keep: bool) -> Drawn:
        """Draw a view.

        Args:
            view: Camera.
            cloud: Parameters.
            features: Shape (N, F).
            keep: Prepare for `derive`.
        """
        self._view, self._cloud, self._features = view, cloud, features
        self._begin(len(cloud.opacities), 0 if features is None else features.shape[1])
        count = bound_chunks(view, cloud, self._bounds, self._chunk_room)
        self._chunks = _first_chunks(self._chunk_room, count)
        self._make_room(count)
        begin_planes(view.width, view.height, self._ws, self._raster)
        self._slab_count = 0
        for slab in slabs_of(self._chunks.depth_m, SLAB_SHARES):
            self._draw_slab(slab, keep)
        count = int(self._ws.counts[RECORDS])
        index, radius_px = (
            _MEMORY.pool.take("index", count, np.int64),
            _MEMORY.pool.take("radius_px", count, np.float32),
        )
        self._rows = list_drawn(self._chunks, self._kept, index, radius_px)
        token = np.zeros(1, dtype=np.float32)
        self._token = weakref.ref(token)
        planes = self._raster.planes.reshape(-1, self._raster.height, self._raster.stride)
        # The caller that holds the images keeps their memory; the frame does not.
        self._raster = self._raster._replace(planes=np.empty(0, dtype=np.float32))
        return Drawn(planes, token, index[: self._rows], radius_px[: self._rows])

    def _begin(self, count: int, features: int) -> None:
        chunks = -(-count // CHUNK)
        if chunks > len(self._chunk_room.number):
            self._chunk_room = _chunk_arrays(chunks + chunks // 4)
        groups = -(-features // FEATURE_GROUP) * FEATURE_GROUP
        raster = self._raster
        if groups != raster.feature_count:
            state = allocate_aligned(16 * (STATE_ROWS + groups) * 16, np.float32)
            raster = raster._replace(feature_count=groups, state=state)
        size = (PLANES + groups) * raster.height * raster.stride
        self._raster = raster._replace(planes=_MEMORY.pool.take("planes", size, np.float32))

    def _make_room(self, chunks: int) -> None:
        """Room for all Gaussians of the chunks, and 16 more for the writes that follow the last one."""
        count = chunks * CHUNK + 16
        self._ws = with_room(self._ws, records=count)
        if count // 16 > len(self._kept.lanes):
            room = (count + count // 4) // 16
            self._kept = self._kept._replace(
                groups=allocate_aligned(room * GROUP, np.float32), lanes=allocate_aligned(room, np.int32)
            )
        if count * self._raster.feature_count > len(self._raster.features):
            room = (count + count // 4) * self._raster.feature_count
            self._raster = self._raster._replace(features=allocate_aligned(room, np.float32))

    def _draw_slab(self, slab: Slab, keep: bool) -> None:
        view, features = self._view, self._features
        if self._slab_count == len(self._slabs):
            self._slabs.append(_SlabLists(self._ws, self._raster))
        lists = self._slabs[self._slab_count]
        first = int(self._ws.counts[RECORDS])
        project(view, self._cloud, self._chunks, slab, keep, self._kept, self._ws)
        if self._ws.counts[KEYS] == 0:
            return
        if features is not None:
            gather_features(features.reshape(-1), features.shape[1], first, self._kept, self._ws, self._raster)
        counts = self._ws.counts
        ws = lists.with_room(lists.of(self._ws), int(4 * counts[KEYS] + counts[LARGE_ENTRIES]))
        blend(view.width, ws, lists.on(self._raster))
        self._slab_count += 1

    def derive(self, planes: Float32Array, slopes: Float32Array, *, absolute: bool, dense: bool) -> FrameGradients:
        """Derivatives of a loss by all parameters.

        Args:
            planes: What `draw` gave.
            slopes: Derivatives of the loss by the planes, in memory that `zero_planes` gave.
            absolute: Also sum up the pixels' absolute derivatives by the projected means.
            dense: Give SH coefficients' derivatives for all Gaussians.
        """
        feature_count = self._raster.feature_count
        absolute_row = FEATURES + feature_count
        record_size = -(-(absolute_row + 2 * absolute) // 16) * 16
        out = self._gradients(record_size, dense)
        raster = self._raster._replace(planes=planes.reshape(-1))
        replay = _MEMORY.pool.take("replay", 2 * raster.height * raster.stride, np.float32)
        begin_replay(self._ws, raster, slopes.reshape(-1), replay, out)
        for lists in self._slabs[: self._slab_count]:
            blend_gradients(
                self._view.width,
                lists.of(self._ws),
                lists.on(raster),
                slopes.reshape(-1),
                replay,
                absolute,
                out,
            )
        rows = project_gradients(self._view, self._cloud, self._chunks, dense, self._kept, out)
        return self._results(out, rows, absolute_row if absolute else None, dense)

    def zero_planes(self) -> Float32Array:
        """Zeros in the layout of the planes, for `derive`."""
        raster = self._raster
        return zeros("slopes", (PLANES + raster.feature_count, raster.height, raster.stride))

    def _gradients(self, record_size: int, dense: bool) -> Gradients:
        room, cloud = self._rows + 16, self._cloud
        features = 0 if self._features is None else self._features.shape[1]
        sh_size = (len(cloud.opacities) if dense else room) * cloud.sh_stride if cloud.sh_count else 0
        sh = _MEMORY.pool.take("sh", sh_size, np.float32)
        if dense or 3 * cloud.sh_count < cloud.sh_stride:
            sh.fill(0.0)
        return Gradients(
            records=_MEMORY.pool.take("records", int(self._ws.counts[RECORDS]) * record_size, np.float32),
            record_size=record_size,
            touched=_MEMORY.pool.take("touched", int(self._ws.counts[RECORDS]) // 16 + 2, np.uint8),
            sums=_MEMORY.pool.take("sums", 16 * 16, np.float32),
            numbers=_MEMORY.pool.take("numbers", room, np.int64),
            means_m=_MEMORY.pool.take("means_m", room * 3, np.float32),
            quats_wxyz=_MEMORY.pool.take("quats_wxyz", room * 4, np.float32),
            scales_m=_MEMORY.pool.take("scales_m", room * 3, np.float32),
            opacities=_MEMORY.pool.take("opacities", room, np.float32),
            sh=sh,
            features=_MEMORY.pool.take("features", room * features, np.float32),
            feature_size=features,
            weights=_MEMORY.pool.take("weights", room, np.float32),
            means_px=_MEMORY.pool.take("means_px", 2 * room, np.float32),
            stride=room,
            pose=_MEMORY.pool.take("pose", 12 * 16, np.float32),
        )

    def _results(self, out: Gradients, m: int, absolute_row: int | None, dense: bool) -> FrameGradients:
        n, stride = self._rows, self._cloud.sh_stride
        pose = out.pose.reshape(12, 16).sum(axis=1, dtype=np.float64)
        sh_rows = len(self._cloud.opacities) if dense else m
        return FrameGradients(
            index=out.numbers[:m],
            means_m=out.means_m[: 3 * m].reshape(m, 3),
            quats_wxyz=out.quats_wxyz[: 4 * m].reshape(m, 4),
            scales_m=out.scales_m[: 3 * m].reshape(m, 3),
            opacities=out.opacities[:m],
            sh=out.sh[: sh_rows * stride].reshape(sh_rows, stride // 3, 3) if self._cloud.sh_count else None,
            features=None
            if self._features is None
            else out.features[: m * out.feature_size].reshape(m, out.feature_size),
            R_CW=pose[:9].reshape(3, 3),
            p_WC=pose[9:],
            means_px=out.means_px.reshape(2, -1)[:, :n].T,
            absolute_px=None if absolute_row is None else LN_2 * self._sums(out, absolute_row, 2),
            weights=out.weights[:n],
        )

    def _sums(self, out: Gradients, first: int, count: int) -> Float32Array:
        """Numbers from `first` on of the gradient records, in the order of rows."""
        rows = np.empty((self._rows, count), dtype=np.float32)
        gather_sums(self._chunks, self._kept, out, first, rows)
        return rows


class _SlabLists:
    """Lists of the tiles of one slab."""

    def __init__(self, ws: Workspace, raster: Raster) -> None:
        self._tile_place = np.zeros_like(ws.tile_place)
        self._node_next = allocate_aligned(0, np.int64)
        self._entry_record = allocate_aligned(0, np.int32)
        self._entry_blocks = allocate_aligned(0, np.uint16)
        self._tile_nodes = np.zeros_like(raster.tile_nodes)
        self._entry_drawn = np.empty(0, dtype=np.uint16)

    def of(self, ws: Workspace) -> Workspace:
        """The workspace with these lists."""
        return ws._replace(
            tile_place=self._tile_place,
            node_next=self._node_next,
            entry_record=self._entry_record,
            entry_blocks=self._entry_blocks,
        )

    def with_room(self, ws: Workspace, entries: int) -> Workspace:
        """The workspace with these lists, large enough."""
        ws = with_room(ws, entries=entries)
        self._node_next, self._entry_record, self._entry_blocks = ws.node_next, ws.entry_record, ws.entry_blocks
        if len(self._entry_drawn) < len(ws.entry_blocks):
            self._entry_drawn = allocate_aligned(len(ws.entry_blocks), np.uint16)
        return ws

    def on(self, raster: Raster) -> Raster:
        """The raster with what is noted of these lists."""
        return raster._replace(tile_nodes=self._tile_nodes, entry_drawn=self._entry_drawn)


def _chunk_arrays(count: int) -> Chunks:
    def integers(each: int = 1) -> Int64Array:
        return np.zeros(count * each, dtype=np.int64)

    return Chunks(integers(), np.zeros(count), integers(), integers(CHUNK // 16), integers(), integers())


def _first_chunks(chunks: Chunks, n: int) -> Chunks:
    number, depth_m, box, lanes, first_group, group_count = chunks
    return Chunks(number[:n], depth_m[:n], box[:n], lanes[: n * CHUNK // 16], first_group[:n], group_count[:n])


def free_frame(height_px: int, width_px: int) -> Frame:
    """A frame that this thread does not use."""
    free = [frame for frame in _MEMORY.frames if not frame.in_use]
    for frame in free:
        if frame.size_px == (height_px, width_px):
            return frame
    if len(free) >= _FREE_FRAMES:
        _MEMORY.frames.remove(free[0])
    frame = Frame(height_px, width_px)
    _MEMORY.frames.append(frame)
    return frame
