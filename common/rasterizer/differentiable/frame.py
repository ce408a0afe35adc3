"""One view, forward and backward, on NumPy arrays."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from common.rasterizer.cpu_blend import begin_tiles, fill_tiles, sort_keys
from common.rasterizer.cpu_tiles import MAX_TILES
from common.rasterizer.cpu_view import View
from common.rasterizer.cpu_workspace import RECORDS, TILE, Workspace, make_workspace, tile_count, with_room
from common.rasterizer.differentiable.blend import blend, gather_features
from common.rasterizer.differentiable.blend_gradients import STATE_ROWS, blend_gradients
from common.rasterizer.differentiable.memory import (
    FEATURE_GROUP,
    GRADIENT_ROWS,
    KEPT_ROWS,
    PLANES,
    RADIUS,
    STAGED_LANES,
    STAGED_ROWS,
    Cloud,
    Gradients,
    Kept,
    Raster,
    Singles,
    aligned,
    row_stride,
)
from common.rasterizer.differentiable.pool import ArrayPool, zeros
from common.rasterizer.differentiable.project import project
from common.rasterizer.differentiable.project_gradients import project_gradients

LN_2 = 0.6931471805599453
_POOL = ArrayPool()


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameGradients:
    """Derivatives of the loss; rows are those of `Frame.index` unless said otherwise."""

    means_m: Singles
    quats_wxyz: Singles
    scales_m: Singles
    opacities: Singles
    sh: Singles | None
    """All Gaussians' rows if they were asked for, shape (n or N, K, 3)."""
    features: Singles | None
    R_CW: npt.NDArray[np.float64]
    """Shape (3, 3)."""
    p_WC: npt.NDArray[np.float64]
    """Shape (3,)."""
    means_px: Singles
    """Shape (n, 2)."""
    absolute_px: Singles | None
    """Sums of the pixels' absolute derivatives by the projected means, shape (n, 2)."""
    weights: Singles
    """Sums of weights over all pixels, shape (n,)."""


class Frame:
    """Memory of one view from its forward to its backward pass."""

    def __init__(self, height_px: int, width_px: int) -> None:
        if tile_count(height_px, width_px) >= MAX_TILES:
            raise ValueError(f"images are limited to {MAX_TILES} tiles of 16x16 px, got {height_px}x{width_px} px.")
        self.size_px = (height_px, width_px)
        self._ws = make_workspace(height_px, width_px, 0, 0)
        self._kept = Kept(
            np.empty(0, dtype=np.int32),
            np.empty(0, dtype=np.float32),
            0,
            np.zeros(STAGED_ROWS * STAGED_LANES, dtype=np.float32),
            np.zeros(59 * 16, dtype=np.float32),
        )
        self._raster = Raster(
            planes=np.empty(0, dtype=np.float32),
            height=-(-height_px // TILE) * TILE,
            stride=-(-width_px // TILE) * TILE,
            features=np.empty(0, dtype=np.float32),
            feature_count=0,
            block_end=np.zeros(16 * tile_count(height_px, width_px), dtype=np.int32),
            weights=aligned(64 * 16, np.float32),
            state=aligned(16 * STATE_ROWS * 16, np.float32),
            block_x=np.tile(np.arange(0, 16, 4, dtype=np.float32), 4),
            block_y=np.repeat(np.arange(0, 16, 4, dtype=np.float32), 4),
        )
        self._token: Callable[[], npt.NDArray[np.float32] | None] = lambda: None

    @property
    def in_use(self) -> bool:
        """True while the token of the last `draw` lives."""
        return self._token() is not None

    @property
    def count(self) -> int:
        """Gaussians that were drawn, n."""
        return int(self._ws.counts[RECORDS])

    @property
    def index(self) -> npt.NDArray[np.int32]:
        """Which ones, ascending, shape (n,)."""
        return self._kept.index[: self.count]

    @property
    def radius_px(self) -> Singles:
        """The larger half side of the box outside of which their alpha is below the threshold, shape (n,)."""
        first = RADIUS * self._kept.stride
        return self._kept.rows[first : first + self.count]

    def draw(self, view: View, cloud: Cloud, features: Singles | None, *, keep: bool) -> tuple[Singles, Singles]:
        """Draw a view.

        Args:
            view: Camera.
            cloud: Parameters.
            features: Shape (N, F).
            keep: Prepare for `derive`.

        Returns:
            Planes as in `memory.PLANES`, with sides that are multiples of 16 px, and the features filled up to a multiple
            of `FEATURE_GROUP`; and a token: the frame stays in use while that lives.
        """
        self._view, self._cloud, self._features = view, cloud, features
        self._make_room(len(cloud.opacities), 0 if features is None else features.shape[1])
        project(view, cloud, keep, self._kept, self._ws)
        self._gather()
        in_sorted = sort_keys(self._ws)
        self._ws = with_room(self._ws, entries=begin_tiles(self._ws))
        fill_tiles(view.width, in_sorted, self._ws)
        blend(view.width, view.height, self._ws, self._raster)
        token = np.zeros(1, dtype=np.float32)
        self._token = weakref.ref(token)
        planes = self._raster.planes.reshape(-1, self._raster.height, self._raster.stride)
        # Whoever holds the images keeps their memory; the frame does not.
        self._raster = self._raster._replace(planes=np.empty(0, dtype=np.float32))
        return planes, token

    def _make_room(self, count: int, features: int) -> None:
        self._ws = with_room(self._ws, records=count + 16)
        if count + 16 > len(self._kept.index):
            stride = row_stride(count + count // 4)
            self._kept = self._kept._replace(
                index=aligned(stride, np.int32), rows=aligned(KEPT_ROWS * stride, np.float32), stride=stride
            )
        groups = -(-features // FEATURE_GROUP) * FEATURE_GROUP
        raster = self._raster
        if groups != raster.feature_count:
            raster = raster._replace(
                feature_count=groups, state=aligned(16 * (STATE_ROWS + groups) * 16, np.float32)
            )
        size = (PLANES + groups) * raster.height * raster.stride
        self._raster = raster._replace(planes=_POOL.take("planes", size, np.float32))

    def _gather(self) -> None:
        if self._features is None:
            return
        if self.count * self._raster.feature_count > len(self._raster.features):
            room = (self.count + self.count // 4) * self._raster.feature_count
            self._raster = self._raster._replace(features=aligned(room, np.float32))
        gather_features(
            self._features.reshape(-1), self._features.shape[1], self.count, self._kept, self._raster
        )

    def derive(
        self, planes: Singles, slopes: Singles, *, with_depth: bool, absolute: bool, dense: bool
    ) -> FrameGradients:
        """Derivatives of a loss by all parameters.

        Args:
            planes: What `draw` gave.
            slopes: Derivatives of the loss by the planes, in memory that `padded` gave.
            with_depth: False if the derivatives by the depth plane are all zero.
            absolute: Also sum up the pixels' absolute derivatives by the projected means.
            dense: Give SH coefficients' derivatives for all Gaussians.
        """
        feature_count = self._raster.feature_count
        record_size = -(-(GRADIENT_ROWS + feature_count + 2 * absolute) // 16) * 16
        out = self._gradients(record_size, dense)
        raster = self._raster._replace(planes=planes.reshape(-1))
        blend_gradients(self._view.width, self._ws, raster, slopes.reshape(-1), with_depth, absolute, out)
        project_gradients(self._view, self._cloud, dense, self._kept, self._ws, out)
        return self._results(out, absolute, dense)

    def padded(self) -> Singles:
        """Zeros in the layout of the planes, for `derive`."""
        raster = self._raster
        size = (PLANES + raster.feature_count) * raster.height * raster.stride
        array = _POOL.take("slopes", size, np.float32)
        array.fill(0.0)
        return array.reshape(-1, raster.height, raster.stride)

    def _gradients(self, record_size: int, dense: bool) -> Gradients:
        room, stride, cloud = self.count + 16, row_stride(self.count), self._cloud
        sh_rows = len(cloud.opacities) if dense else room
        if cloud.sh_count == 0:
            sh = np.empty(0, dtype=np.float32)
        elif dense or 3 * cloud.sh_count < cloud.sh_stride:
            sh = zeros(sh_rows * cloud.sh_stride, np.float32)
        else:
            sh = _POOL.take("sh", sh_rows * cloud.sh_stride, np.float32)
        return Gradients(
            records=_POOL.take("records", room * record_size, np.float32),
            record_size=record_size,
            sums=_POOL.take("sums", max(record_size, 16) * 16, np.float32),
            means_m=_POOL.take("means_m", room * 3, np.float32),
            quats_wxyz=_POOL.take("quats_wxyz", room * 4, np.float32),
            scales_m=_POOL.take("scales_m", room * 3, np.float32),
            opacities=_POOL.take("opacities", room, np.float32),
            sh=sh,
            weights=_POOL.take("weights", room, np.float32),
            means_px=_POOL.take("means_px", 2 * stride, np.float32),
            stride=stride,
            pose=_POOL.take("pose", 12 * 16, np.float32),
        )

    def _results(self, out: Gradients, absolute: bool, dense: bool) -> FrameGradients:
        n, stride = self.count, self._cloud.sh_stride
        records = out.records.reshape(-1, out.record_size)[:n]
        used = GRADIENT_ROWS + self._raster.feature_count
        pose = out.pose.reshape(12, 16).sum(axis=1, dtype=np.float64)
        sh_rows = len(self._cloud.opacities) if dense else n
        features = self._features
        return FrameGradients(
            means_m=out.means_m[: 3 * n].reshape(n, 3),
            quats_wxyz=out.quats_wxyz[: 4 * n].reshape(n, 4),
            scales_m=out.scales_m[: 3 * n].reshape(n, 3),
            opacities=out.opacities[:n],
            sh=out.sh[: sh_rows * stride].reshape(sh_rows, -1, 3) if self._cloud.sh_count else None,
            features=None
            if features is None
            else records[:, GRADIENT_ROWS : GRADIENT_ROWS + features.shape[1]].copy(),
            R_CW=pose[:9].reshape(3, 3),
            p_WC=pose[9:],
            means_px=out.means_px.reshape(2, -1)[:, :n].T,
            absolute_px=LN_2 * records[:, used : used + 2] if absolute else None,
            weights=out.weights[:n],
        )


_FRAMES: list[Frame] = []
_FREE_FRAMES = 4


def free_frame(height_px: int, width_px: int) -> Frame:
    """A frame that is not in use."""
    free = [frame for frame in _FRAMES if not frame.in_use]
    for frame in free:
        if frame.size_px == (height_px, width_px):
            return frame
    if len(free) >= _FREE_FRAMES:
        _FRAMES.remove(free[0])
    frame = Frame(height_px, width_px)
    _FRAMES.append(frame)
    return frame
