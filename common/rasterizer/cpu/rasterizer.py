"""The CPU rasterizer: a static scene, its sky and posed humans in one depth-sorted pass."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, partial

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray, Float32Array, Int16Array
from readygo.common.avatars import Avatar, joint_transforms
from readygo.common.gaussians.irradiance import rotate_forms
from readygo.common.images.images import Images, empty_images
from readygo.common.rasterizer.cpu import blend as cpu_blend
from readygo.common.rasterizer.cpu.lod_cull import COARSENESS, Cut, cull_human_tree, cull_tree
from readygo.common.rasterizer.cpu.outputs import Sums, instance_of_records, write_images
from readygo.common.rasterizer.cpu.project import FlatScene, FlatSkin, Lit, project_human, project_scene
from readygo.common.rasterizer.cpu.slabs import FAR_BITS, Slab, slabs_of
from readygo.common.rasterizer.cpu.view import PinholeView, VisibleChunks, cull_human, cull_scene, make_view
from readygo.common.rasterizer.cpu.workspace import (
    KEYS,
    LARGE_ENTRIES,
    MAX_SIDE_PX,
    RECORDS,
    Depths,
    Workspace,
    make_depths,
    make_normals,
    make_workspace,
    with_room,
)
from readygo.common.rasterizer.interface import PosedHuman, View, checked_outputs, lead_terms
from readygo.common.rasterizer.lod.avatar import AvatarTree
from readygo.common.rasterizer.lod.tree import ChunkTree
from readygo.common.rasterizer.packed.avatar import PackedAvatar, pack_avatar, packed_shading
from readygo.common.rasterizer.packed.few import pack_few
from readygo.common.rasterizer.packed.scene import CHUNK, PackedScene

_RGB_ONLY = Sums()
Shading = Callable[[], Int16Array]
"""Gives the normals of an avatar that light falls on, flat."""


def _read_only_view(array: AnyArray) -> AnyArray:
    """A read-only plain view: mapped and other packs then have one numba type, so that kernels compile once."""
    view = array.view(np.ndarray)
    view.flags.writeable = False
    return view


_UNLIT = Lit(_read_only_view(np.empty(0, dtype=np.int16)), np.empty(0, dtype=np.float32))


class _Layer:
    """One cloud of the image: its chunks that may be seen, and how to project some of them."""

    def __init__(self, scene: PackedScene, cut: Cut | None = None) -> None:
        self._cut = cut
        self.gaussians = FlatScene(
            _read_only_view(scene.centre_m),
            _read_only_view(scene.geometry).reshape(-1),
            _read_only_view(scene.colour).reshape(-1),
            _read_only_view(scene.sh).reshape(-1),
            float(scene.sh_step[0]),
            scene.sh.shape[3] if len(scene.sh) else 1,
        )
        self.normal = None if scene.normal is None else _read_only_view(scene.normal).reshape(-1)
        self.scene = scene
        self._boxes = _read_only_view(scene.centre_m), _read_only_view(scene.half_m), _read_only_view(scene.reach_m)
        self._chunks = VisibleChunks(
            np.empty(scene.chunk_count, dtype=np.int64),
            np.empty(scene.chunk_count, dtype=np.float64),
            np.empty(scene.chunk_count, dtype=np.int64),
            np.empty((2, 3), dtype=np.float64),
        )

    def cull(self, view: PinholeView) -> VisibleChunks:
        if self._cut is None:
            count = cull_scene(view, *self._boxes, self._chunks)
        else:
            count = cull_tree(view, *self._boxes, self._cut, self._chunks)
        return self._first(count)

    def _first(self, count: int) -> VisibleChunks:
        number, depth_m, box, corners = self._chunks
        return VisibleChunks(number[:count], depth_m[:count], box[:count], corners)

    def want_normals(self, wanted: bool) -> None:
        """Project with normals from now on, or without."""
        self.gaussians = self.gaussians._replace(normal=self.normal if wanted else None)

    def project(self, view: PinholeView, chunks: VisibleChunks, slab: Slab, ws: Workspace) -> None:
        project_scene(view, self.gaussians, chunks, slab, ws)


class _Human(_Layer):
    """A human of the image."""

    def __init__(self, avatar: Avatar, packed: PackedAvatar, cut: Cut | None, shading: Shading) -> None:
        super().__init__(packed.scene, cut)
        self.avatar, self.packed, self._shading = avatar, packed, shading
        self.skin = FlatSkin(
            _read_only_view(packed.joint_start),
            _read_only_view(packed.joint),
            _read_only_view(packed.weight).reshape(-1),
        )
        arrays = (packed.box_start, packed.box_joint, packed.box_centre_m, packed.box_half_m)
        self._joint_boxes = tuple(_read_only_view(array) for array in arrays)
        self._A_CS = np.empty((24, 3, 4), dtype=np.float32)
        self._light = np.empty((3, 10), dtype=np.float32)

    def pose(self, human: PosedHuman, view: PinholeView) -> None:
        A_WS = joint_transforms(self.avatar, human.root_m, human.pose_axis_angle)
        A_WS[:, :, 3] -= view.p_WC
        R = view.R_CW
        for i in range(3):
            self._A_CS[:, i] = R[i, 0] * A_WS[:, 0] + R[i, 1] * A_WS[:, 1] + R[i, 2] * A_WS[:, 2]
        self._lit = _UNLIT
        if human.light is not None:
            rotate_forms(human.light, R, self._light)
            self._lit = Lit(self._shading(), self._light.reshape(-1))
        self._lead = lead_terms(human, R, view.p_WC)

    def cull(self, view: PinholeView) -> VisibleChunks:
        boxes = (view, self._lead, self._A_CS, *self._joint_boxes, self._boxes[2])
        count = (
            cull_human(*boxes, self._chunks) if self._cut is None else cull_human_tree(*boxes, self._cut, self._chunks)
        )
        return self._first(count)

    def project(self, view: PinholeView, chunks: VisibleChunks, slab: Slab, ws: Workspace) -> None:
        project_human(view, self.gaussians, self.skin, self._lit, self._lead, self._A_CS, chunks, slab, ws)


class CpuRasterizer:
    """Draws views of one scene with one camera, one after the other; see `readygo.common.rasterizer.interface`.

    Chunks are drawn in a few slabs of depth, nearest first, so that what lies behind finished pixels is neither
    projected nor sorted.

    Args:
        scenes: Static clouds, such as a scene and its sky; those that are trees are drawn with levels of detail.
        avatars: Who may be drawn, by name.
        K_px: Intrinsics [px] without skew, shape (3, 3).
        height_px: Image height.
        width_px: Image width.
        packed_avatars: The avatars packed; those that are trees are drawn with levels of detail. Packed here by
            default.

    Raises:
        ValueError: If the image is too large, or the packed avatars are others.
    """

    views_at_once = 1

    def __init__(
        self,
        scenes: PackedScene | ChunkTree | Sequence[PackedScene | ChunkTree],
        avatars: Mapping[str, Avatar],
        K_px: npt.ArrayLike,
        height_px: int,
        width_px: int,
        *,
        packed_avatars: Mapping[str, PackedAvatar | AvatarTree] | None = None,
    ) -> None:
        if max(height_px, width_px) > MAX_SIDE_PX:
            raise ValueError(f"images are limited to {MAX_SIDE_PX} px a side, got {height_px}x{width_px} px.")
        scenes = [scenes] if isinstance(scenes, PackedScene | ChunkTree) else scenes
        self._layers = [_Layer(*_with_cut(scene)) for scene in scenes]
        packed = packed_avatars or {name: pack_avatar(avatar) for name, avatar in avatars.items()}
        if packed.keys() != avatars.keys():
            raise ValueError(f"packed_avatars must be those of {sorted(avatars)}, got {sorted(packed)}.")
        self._avatars = {name: _wearable(avatar, *_avatar_with_cut(packed[name])) for name, avatar in avatars.items()}
        self._humans: list[_Human] = []
        self._K_px = np.asarray(K_px, dtype=np.float64)
        self._height, self._width = height_px, width_px
        self._ws = make_workspace(height_px, width_px)
        self._record_ends: list[int] = []

    def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
        """The images of views; see `Rasterizer.render`.

        Each new set of kinds of images (depths and mask; normals) is compiled when it is first asked for.

        Raises:
            ValueError: As `Rasterizer.render`, or if normals are wanted of a scene that was packed without.
        """
        wanted = checked_outputs(views, outputs, self._avatars)
        if "normal" in wanted and any(layer.normal is None for layer in self._layers):
            raise ValueError("normals need scenes that were packed with them; pass normals=True when packing.")
        images = empty_images(len(views), self._height, self._width, wanted)
        for number, view in enumerate(views):
            self._render_into(images[number], view, wanted)
        return images

    def render_float(self, view: View) -> Float32Array:
        """The colours of a view before rounding, not clipped above 1, shape (H, W, 3)."""
        checked_outputs([view], (), self._avatars)
        self._draw(view, self._with_shadows(view))
        rgb = np.empty((self._height, self._width, 3), dtype=np.float32)
        cpu_blend.write_floats(self._width, self._ws, rgb)
        return rgb

    def _render_into(self, images: Images, view: View, wanted: frozenset[str]) -> None:
        others = wanted - {"rgb"}
        if view.shadows is not None:
            self._draw(view, self._with_shadows(view))
            cpu_blend.write_bytes(self._width, self._ws, images.rgb)
            if not others:
                return
        sums = Sums(self._depths if others - {"alpha"} else None, self._normals if "normal" in others else None)
        self._draw(view, self._layers, sums)
        if view.shadows is None:
            cpu_blend.write_bytes(self._width, self._ws, images.rgb)
        ids = [0] * len(self._layers) + list(range(1, len(view.humans) + 1))
        instances = instance_of_records(self._record_ends, ids) if "mask" in others else None
        write_images(others, images, self._ws, sums, instances)

    def _with_shadows(self, view: View) -> list[_Layer]:
        return self._layers if view.shadows is None else [*self._layers, _Layer(pack_few(view.shadows))]

    @cached_property
    def _depths(self) -> Depths:
        return make_depths(self._height, self._width)

    @cached_property
    def _normals(self) -> Float32Array:
        return make_normals(self._height, self._width)

    def _draw(self, shown: View, scene: Sequence[_Layer], sums: Sums = _RGB_ONLY) -> None:
        pose = np.asarray(shown.T_world_camera, dtype=np.float64)
        view = make_view(pose, self._K_px if shown.K_px is None else shown.K_px, self._height, self._width)
        layers = [*scene, *self._pose(shown.humans, view)]
        for layer in layers:
            layer.want_normals(sums.normals is not None)
        seen = [layer.cull(view) for layer in layers]
        ranges_m = [(chunks.depth_m.min(initial=np.inf), chunks.depth_m.max(initial=-np.inf)) for chunks in seen]
        self._ws = with_room(self._ws, records=CHUNK * sum(len(chunks.number) for chunks in seen))
        cpu_blend.begin_image(self._width, self._height, self._ws)
        self._record_ends.clear()
        sums.clear()
        slabs = slabs_of(np.concatenate([np.empty(0), *(chunks.depth_m for chunks in seen)]))
        for slab, next_limit_bits in zip(slabs, [*(slab.limit_bits for slab in slabs[1:]), FAR_BITS], strict=True):
            for layer, chunks, (nearest_m, farthest_m) in zip(layers, seen, ranges_m, strict=True):
                if nearest_m < slab.limit_m and farthest_m >= slab.first_m:
                    layer.project(view, chunks, slab, self._ws)
                self._record_ends.append(int(self._ws.counts[RECORDS]))
            # Each key meets up to four tiles, or all that its large box meets.
            counts = self._ws.counts
            self._ws = with_room(self._ws, entries=int(4 * counts[KEYS] + counts[LARGE_ENTRIES]))
            cpu_blend.draw_slab(self._width, next_limit_bits, self._ws, sums.depths, sums.normals)

    def _pose(self, humans: Sequence[PosedHuman], view: PinholeView) -> list[_Layer]:
        """A layer per human; layers are kept for the next image."""
        for human in humans[len(self._humans) :]:
            self._humans.append(_Human(*self._avatars[human.avatar]))
        layers: list[_Layer] = []
        for place, human in enumerate(humans):
            avatar = self._avatars[human.avatar][0]
            if self._humans[place].avatar is not avatar:
                self._humans[place] = _Human(*self._avatars[human.avatar])
            self._humans[place].pose(human, view)
            layers.append(self._humans[place])
        return layers


def _wearable(
    avatar: Avatar, packed: PackedAvatar, cut: Cut | None
) -> tuple[Avatar, PackedAvatar, Cut | None, Shading]:
    # Made when the avatar is lit for the first time: some 20 ms per 100,000 Gaussians.
    return avatar, packed, cut, cache(partial(_shading, packed, avatar.joints_canonical_m))


def _shading(packed: PackedAvatar, joints_m: Float32Array) -> Int16Array:
    return _read_only_view(packed_shading(packed, joints_m)).reshape(-1)


def _cut(tree: ChunkTree | AvatarTree) -> Cut:
    return Cut(_read_only_view(tree.skip), _read_only_view(tree.pixel_m), COARSENESS)


def _with_cut(scene: PackedScene | ChunkTree) -> tuple[PackedScene, Cut | None]:
    return (scene.scene, _cut(scene)) if isinstance(scene, ChunkTree) else (scene, None)


def _avatar_with_cut(packed: PackedAvatar | AvatarTree) -> tuple[PackedAvatar, Cut | None]:
    return (packed.avatar, _cut(packed)) if isinstance(packed, AvatarTree) else (packed, None)
