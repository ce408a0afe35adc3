"""From a batch of cameras and humans to images, with the Triton kernels; nothing waits for the device in between."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from readygo.common.arrays import Float64Array
from readygo.common.avatars.torch_posing import joint_transforms
from readygo.common.rasterizer.gpu.batch import ViewBatch
from readygo.common.rasterizer.gpu.device_clouds import DeviceClouds
from readygo.common.rasterizer.gpu.light import TERMS, turned_terms
from readygo.common.rasterizer.gpu.triton.blend import COLOUR_PLANES, DEPTH_PLANES, NORMAL_PLANES, blend
from readygo.common.rasterizer.gpu.triton.buffers import Buffers, make_buffers
from readygo.common.rasterizer.gpu.triton.cull import cull_humans, cull_scene, list_pairs, select_chunks
from readygo.common.rasterizer.gpu.triton.project import project
from readygo.common.rasterizer.gpu.triton.settings import TritonSettings
from readygo.common.rasterizer.gpu.triton.tiles import bin_entries, sort_lists

FAR_M = 1e30
"""Depth beyond every Gaussian [m]."""
_FUSED = {"enable_fp_fusion": True}
"""Multiply-adds shall be fused; Triton's default changes between versions."""
_LANES = 128
"""Chunks that a program culls."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """What the cameras see of the instances of chunks; B cameras, I instances."""

    instances: int
    views: Tensor
    """R_CW and p_WC, float32, shape (B, 12)."""
    humans: Tensor
    """Avatars, shape (B * P,)."""
    transforms: Tensor
    """Joints from canonical to camera coordinates, shape (B * P, 24, 12)."""
    lights: Tensor
    """Terms of the light on each human in the camera's frame, shape (B * P, 3, 10)."""
    offsets: Tensor
    nears: Tensor
    fars: Tensor
    boxes: Tensor
    edges: Tensor
    """Depths at which the slabs begin and end, shape (B, S + 1)."""


class TritonPipeline:
    """Draws batches of cameras over one set of clouds; not to be shared between threads.

    Args:
        clouds: Scenes and avatars.
        K_px: Intrinsics [px] without skew, shape (3, 3).
        height_px: Image height.
        width_px: Image width.
        settings: Tiles, slabs and sizes of launches; large images get larger tiles.
        device: Where `clouds` are.

    Raises:
        ReadygoError: If the image is too large for the largest tiles.
    """

    def __init__(
        self,
        clouds: DeviceClouds,
        K_px: Float64Array,
        height_px: int,
        width_px: int,
        settings: TritonSettings,
        device: torch.device,
    ) -> None:
        settings = settings.for_image(height_px, width_px)
        self._columns = -(-width_px // settings.tile_width_px)
        self._rows = -(-height_px // settings.tile_height_px)
        self._clouds, self._settings, self._device = clouds, settings, device
        self._height, self._width = height_px, width_px
        K = [float(K_px[0, 0]), float(K_px[1, 1]), float(K_px[0, 2]), float(K_px[1, 2])]
        self._lens = (*K, float(width_px), float(height_px))
        self._shares = torch.tensor(settings.slab_shares, dtype=torch.float32, device=device)
        self._programs = settings.programs_per_processor * _processor_count(device)
        self._needed = torch.zeros(2, dtype=torch.int64, device=device)
        self._buffers: Buffers | None = None
        self.clock: Callable[[str], None] = _no_clock
        """Called with the name of each stage when it begins."""

    def draw(self, batch: ViewBatch, *, depth: bool = False, normals: bool = False) -> Tensor:
        """Draw all cameras of a batch.

        Args:
            batch: Cameras and humans.
            depth: Make the planes of `DEPTH_PLANES`.
            normals: Make the planes of `NORMAL_PLANES`.

        Returns:
            Planes as `blend` leaves them, shape (B, planes, H, W).
        """
        cameras = len(batch.T_world_camera)
        count = COLOUR_PLANES + depth * DEPTH_PLANES + normals * NORMAL_PLANES
        planes = torch.empty((cameras, count, self._height, self._width), device=self._device)
        step = self._settings.cameras_per_pass
        while True:
            self._needed.zero_()
            for first in range(0, cameras, step):
                self.attempt(batch.part(first, first + step), planes[first : first + step], depth, normals)
            if self._check_capacity(normals):
                return planes

    def attempt(self, batch: ViewBatch, planes: Tensor, depth: bool, normals: bool) -> None:
        """Draw up to `cameras_per_pass` cameras; what does not fit into the buffers is left out and remembered."""
        planes.zero_()
        planes[:, COLOUR_PLANES - 1] = 1.0
        if depth:
            planes[:, COLOUR_PLANES + 1] = torch.inf
        cameras = len(planes)
        if cameras * self._instances(batch) == 0:
            return
        buffers = self._roomy(cameras * self._instances(batch), normals)
        self.clock("cull")
        seen = self._cull(batch)
        alive = torch.ones((cameras, self._rows * self._columns), dtype=torch.int32, device=self._device)
        for slab in range(len(self._settings.slab_shares) + 1):
            self.clock("select")
            pair_total = self._select(seen, alive, slab, buffers)
            self.clock("project")
            self._project(seen, alive, slab, pair_total, buffers, normals)
            self.clock("bin")
            starts, counts = self._bin(seen, alive, pair_total, buffers)
            self.clock("sort")
            in_spare = self._sort(starts, counts, buffers)
            self.clock("blend")
            blend[(len(counts),)](
                buffers.entries, buffers.spare, starts, counts, in_spare, buffers.entry_capacity,
                buffers.records, buffers.record_normals, buffers.owners, planes, alive, self._width, self._height,
                PLANES=planes.shape[1], DEPTH=depth, NORMALS=normals, **self._tiles(),
                num_warps=self._settings.blend_warps, **_FUSED,
            )  # fmt: skip

    def _instances(self, batch: ViewBatch) -> int:
        return self._clouds.scene_chunks + batch.avatar.shape[1] * self._clouds.human_chunks

    def _tiles(self) -> dict[str, int]:
        return {
            "TILE_W": self._settings.tile_width_px,
            "TILE_H": self._settings.tile_height_px,
            "COLUMNS": self._columns,
            "ROWS": self._rows,
        }

    def _cull(self, batch: ViewBatch) -> _Seen:
        """Bounds of all instances, and the depths of the slabs."""
        clouds, (cameras, human_count) = self._clouds, batch.avatar.shape
        instances = self._instances(batch)
        R_CW, p_WC = batch.T_world_camera[:, :3, :3].mT, batch.T_world_camera[:, :3, 3]
        views = torch.cat([R_CW.reshape(cameras, 9), p_WC], dim=1).contiguous()
        humans = batch.avatar.reshape(-1)
        A_CS = _camera_transforms(clouds, batch, R_CW, p_WC)

        def empty(dtype: torch.dtype, *shape: int) -> Tensor:
            return torch.empty((cameras, instances, *shape), dtype=dtype, device=self._device)

        offsets, nears, fars = empty(torch.float32, 3), empty(torch.float32), empty(torch.float32)
        boxes = empty(torch.int32)
        sizes = {
            "TILE_W": self._settings.tile_width_px,
            "TILE_H": self._settings.tile_height_px,
            "LANES": _LANES,
            **_FUSED,
        }
        if clouds.scene_chunks:
            cull_scene[(cameras, _blocks(clouds.scene_chunks))](
                views, clouds.centres, clouds.halves, clouds.reaches, offsets, nears, fars, boxes,
                clouds.scene_chunks, instances, *self._lens, **sizes,
            )  # fmt: skip
        if human_count * clouds.human_chunks:
            cull_humans[(cameras * human_count, _blocks(clouds.human_chunks))](
                humans, A_CS, clouds.first_chunks, clouds.chunk_counts,
                clouds.box_joints, clouds.box_centres, clouds.box_halves, clouds.reaches[clouds.scene_chunks :],
                nears, fars, boxes, clouds.scene_chunks, clouds.human_chunks, human_count, instances, *self._lens,
                BOXES=clouds.box_count, **sizes,
            )  # fmt: skip
        return _Seen(
            instances=instances,
            views=views.float(),
            humans=humans,
            transforms=A_CS,
            lights=_camera_lights(batch, R_CW),
            offsets=offsets,
            nears=nears,
            fars=fars,
            boxes=boxes,
            edges=self._edges(nears),
        )

    def _edges(self, nears: Tensor) -> Tensor:
        """Depths at which the slabs begin and end [m]: shares of each camera's visible chunks, shape (B, S + 1)."""
        visible = (nears < FAR_M).sum(dim=1, keepdim=True)
        limits = nears.sort(dim=1).values.gather(1, (visible * self._shares).long())
        return functional.pad(functional.pad(limits, (1, 0), value=-FAR_M), (0, 1), value=FAR_M)

    def _select(self, seen: _Seen, alive: Tensor, slab: int, buffers: Buffers) -> Tensor:
        """List the chunks of a slab; their number, shape (1,)."""
        cameras, instances = seen.nears.shape
        flags = torch.empty_like(seen.boxes)
        select_chunks[(cameras, _blocks(instances))](
            seen.nears, seen.fars, seen.boxes, seen.edges, self._alive_sums(alive), flags, slab, instances,
            SLABS=seen.edges.shape[1] - 1, COLUMNS=self._columns, ROWS=self._rows, LANES=_LANES, **_FUSED,
        )  # fmt: skip
        ends = flags.view(-1).cumsum(0, dtype=torch.int32)
        list_pairs[(_blocks(len(ends)),)](
            flags, ends, buffers.pairs, len(ends), buffers.pair_capacity, LANES=_LANES, **_FUSED
        )
        self._needed[:1] = torch.maximum(self._needed[:1], ends[-1:])
        # A copy is aligned like every tensor: kernels are not recompiled for other numbers of instances.
        return ends[-1:].clone()

    def _alive_sums(self, alive: Tensor) -> Tensor:
        grid = alive.view(-1, self._rows, self._columns)
        sums = grid.cumsum(1, dtype=torch.int32).cumsum(2, dtype=torch.int32)
        return functional.pad(sums, (1, 0, 1, 0)).contiguous()

    def _project(
        self, seen: _Seen, alive: Tensor, slab: int, pair_total: Tensor, buffers: Buffers, normals: bool
    ) -> None:
        clouds = self._clouds
        human_count = max(len(seen.humans) // len(seen.nears), 1)
        project[(self._programs,)](
            buffers.pairs, pair_total, buffers.pair_capacity, seen.humans, seen.transforms, seen.lights,
            clouds.first_chunks, clouds.joints, clouds.weights, clouds.shading, seen.views, seen.offsets,
            clouds.geometry, clouds.colours,
            clouds.sh, clouds.sh_rows, clouds.normals, seen.edges, self._alive_sums(alive),
            buffers.records, buffers.record_normals, buffers.rects, buffers.depths, buffers.owners,
            slab, clouds.scene_chunks, max(clouds.human_chunks, 1), human_count, seen.instances, *self._lens,
            SLABS=seen.edges.shape[1] - 1, SH_COUNT=clouds.sh_count, NORMALS=normals, **self._tiles(),
            num_warps=self._settings.project_warps, **_FUSED,
        )  # fmt: skip

    def _bin(self, seen: _Seen, alive: Tensor, pair_total: Tensor, buffers: Buffers) -> tuple[Tensor, Tensor]:
        """Write the lists of all tiles; where they begin and how long they are."""
        counts = torch.zeros(alive.numel(), dtype=torch.int32, device=self._device)
        starts = torch.zeros(alive.numel(), dtype=torch.int64, device=self._device)

        def visit(places: Tensor, write: bool) -> None:
            bin_entries[(self._programs,)](
                buffers.pairs, pair_total, buffers.pair_capacity, buffers.rects, buffers.depths, alive, starts, places,
                buffers.entries, buffers.entry_capacity, seen.instances,
                WRITE=write, COLUMNS=self._columns, ROWS=self._rows, num_warps=self._settings.project_warps, **_FUSED,
            )  # fmt: skip

        visit(counts, False)
        ends = counts.cumsum(0, dtype=torch.int64)
        torch.sub(ends, counts, out=starts)
        visit(torch.zeros_like(counts), True)
        self._needed[1:] = torch.maximum(self._needed[1:], ends[-1:])
        return starts, counts

    def _sort(self, starts: Tensor, counts: Tensor, buffers: Buffers) -> Tensor:
        """Sort all lists; 1 for those whose sorted form is in the spare buffer."""
        in_spare, settings = torch.zeros_like(counts), self._settings
        lists = (buffers.entries, buffers.spare, starts, counts, buffers.entry_capacity, in_spare)
        limit = settings.long_sort_run
        sort_lists[(len(counts),)](*lists, 2, limit, RUN=settings.sort_run, num_warps=settings.sort_warps, **_FUSED)
        sort_lists[(len(counts),)](
            *lists, limit + 1, 2**31 - 1, RUN=limit, num_warps=settings.long_sort_warps, **_FUSED
        )
        return in_spare

    def _roomy(self, instances: int, normals: bool) -> Buffers:
        """The buffers; of a first guess if there are none that hold what is wanted."""
        held = self._buffers
        if held is None or (normals and len(held.record_normals) == 1):
            pairs = held.pair_capacity if held else min(instances, max(256, instances // 4))
            entries = held.entry_capacity if held else 2 * 256 * pairs
            held = self._make_buffers(pairs, entries, normals)
        return held

    def _check_capacity(self, normals: bool) -> bool:
        """False if attempts left something out; the buffers are larger then. Waits for the device."""
        held = self._buffers
        if held is None:
            return True
        pairs, entries = self._needed.tolist()
        if pairs <= held.pair_capacity and entries <= held.entry_capacity:
            return True
        # An eighth more than needed: the next batch will be a little different.
        wanted = max(held.pair_capacity, pairs + pairs // 8), max(held.entry_capacity, entries + entries // 8)
        normals |= len(held.record_normals) > 1
        del held
        self._buffers = None
        self._make_buffers(*wanted, normals)
        return False

    def _make_buffers(self, pairs: int, entries: int, normals: bool) -> Buffers:
        self._buffers = make_buffers(pairs, entries, normals, self._device)
        return self._buffers


def _camera_transforms(clouds: DeviceClouds, batch: ViewBatch, R_CW: Tensor, p_WC: Tensor) -> Tensor:
    """Transforms of humans' joints from canonical to camera coordinates, float32, shape (B * P, 24, 12)."""
    cameras, human_count = batch.avatar.shape
    if human_count == 0 or clouds.human_chunks == 0:
        return torch.zeros((1, 24, 12), device=R_CW.device)
    A_WS = joint_transforms(
        clouds.skeletons,
        batch.avatar.reshape(-1).clamp(min=0).long(),
        batch.root_m.reshape(-1, 3),
        batch.pose_axis_angle.reshape(-1, 24, 3),
    ).reshape(cameras, human_count, 24, 3, 4)
    A_WS[..., 3] -= p_WC[:, None, None]
    return (R_CW[:, None, None] @ A_WS).float().reshape(cameras * human_count, 24, 12).contiguous()


def _camera_lights(batch: ViewBatch, R_CW: Tensor) -> Tensor:
    """Terms of the light on humans in their camera's frame, float32, shape (B * P, 3, 10); without humans one row."""
    if batch.light.numel() == 0:
        return torch.zeros((1, 3, TERMS), device=R_CW.device)
    return turned_terms(batch.light, R_CW[:, None]).float().reshape(-1, 3, TERMS).contiguous()


def _blocks(count: int) -> int:
    return -(-count // _LANES)


def _processor_count(device: torch.device) -> int:
    return torch.cuda.get_device_properties(device).multi_processor_count if device.type == "cuda" else 1


def _no_clock(_stage: str) -> None:
    pass
