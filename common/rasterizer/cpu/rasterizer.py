"""The CPU rasterizer: a static scene, its sky and posed people in one depth-sorted pass."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.avatars import Avatar, joint_transforms
from readygo.common.gaussians import GaussianCloud
from readygo.common.images.images import Images, require_outputs
from readygo.common.rasterizer.cpu import blend as cpu_blend
from readygo.common.rasterizer.cpu.lod_cull import COARSENESS, Cut, cull_person_tree, cull_tree
from readygo.common.rasterizer.cpu.outputs import MAX_PEOPLE, Sums, instance_of_records, write_images
from readygo.common.rasterizer.cpu.project import Gaussians, Skin, project_person, project_scene
from readygo.common.rasterizer.cpu.slabs import FAR_BITS, Slab, slabs_of
from readygo.common.rasterizer.cpu.view import View, VisibleChunks, cull_person, cull_scene, make_view
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
from readygo.common.rasterizer.lod.avatar import AvatarTree
from readygo.common.rasterizer.lod.tree import ChunkTree
from readygo.common.rasterizer.packed.avatar import PackedAvatar, pack_avatar
from readygo.common.rasterizer.packed.scene import CHUNK, PackedScene, pack_sorted

_RGB_ONLY = Sums()


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedPerson:
    """A person in one pose."""

    avatar: int
    """Index of the avatar in the rasterizer's sequence."""
    root_m: npt.NDArray[np.floating]
    """Pelvis in the z-up world [m], shape (3,)."""
    pose_axis_angle: npt.NDArray[np.floating]
    """Joint rotations [rad] as in `Motion`, shape (24, 3)."""


def _frozen(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A read-only plain view: mapped and other packs then have one numba type, so that kernels compile once."""
    view = array.view(np.ndarray)
    view.flags.writeable = False
    return view


class _Layer:
    """One cloud of the image: its chunks that may be seen, and how to project some of them."""

    def __init__(self, scene: PackedScene, cut: Cut | None = None) -> None:
        self._cut = cut
        self.gaussians = Gaussians(
            _frozen(scene.centre_m),
            _frozen(scene.geometry).reshape(-1),
            _frozen(scene.colour).reshape(-1),
            _frozen(scene.sh).reshape(-1),
            float(scene.sh_step[0]),
            scene.sh.shape[3] if len(scene.sh) else 1,
        )
        self.normal = None if scene.normal is None else _frozen(scene.normal).reshape(-1)
        self.scene = scene
        self._boxes = _frozen(scene.centre_m), _frozen(scene.half_m), _frozen(scene.reach_m)
        self._chunks = VisibleChunks(
            np.empty(scene.chunk_count, dtype=np.int64),
            np.empty(scene.chunk_count, dtype=np.float64),
            np.empty(scene.chunk_count, dtype=np.int64),
            np.empty((2, 3), dtype=np.float64),
        )

    def cull(self, view: View) -> VisibleChunks:
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

    def project(self, view: View, chunks: VisibleChunks, slab: Slab, ws: Workspace) -> None:
        project_scene(view, self.gaussians, chunks, slab, ws)


class _Person(_Layer):
    """A person of the image."""

    def __init__(self, avatar: Avatar, packed: PackedAvatar, cut: Cut | None) -> None:
        super().__init__(packed.scene, cut)
        self.avatar, self.packed = avatar, packed
        self.skin = Skin(_frozen(packed.joint_start), _frozen(packed.joint), _frozen(packed.weight).reshape(-1))
        arrays = (packed.box_start, packed.box_joint, packed.box_centre_m, packed.box_half_m)
        self._joint_boxes = tuple(_frozen(array) for array in arrays)
        self._A_CS = np.empty((24, 3, 4), dtype=np.float32)

    def pose(self, person: PosedPerson, view: View) -> None:
        A_WS = joint_transforms(self.avatar, person.root_m, person.pose_axis_angle)
        A_WS[:, :, 3] -= view.p_WC
        R = view.R_CW
        for i in range(3):
            self._A_CS[:, i] = R[i, 0] * A_WS[:, 0] + R[i, 1] * A_WS[:, 1] + R[i, 2] * A_WS[:, 2]

    def cull(self, view: View) -> VisibleChunks:
        boxes = (view, self._A_CS, *self._joint_boxes, self._boxes[2])
        count = (
            cull_person(*boxes, self._chunks)
            if self._cut is None
            else cull_person_tree(*boxes, self._cut, self._chunks)
        )
        return self._first(count)

    def project(self, view: View, chunks: VisibleChunks, slab: Slab, ws: Workspace) -> None:
        project_person(view, self.gaussians, self.skin, self._A_CS, chunks, slab, ws)


class CpuRasterizer:
    """Renders one scene with people in it, for one camera; not to be shared between threads.

    Chunks are drawn in a few slabs of depth, nearest first, so that what lies behind finished pixels is neither
    projected nor sorted.

    Args:
        scenes: Static clouds, such as a scene and its sky; those that are trees are drawn with levels of detail.
        avatars: Who may be drawn.
        K_px: Intrinsics [px] without skew, shape (3, 3).
        height_px: Image height.
        width_px: Image width.
        packed_avatars: The avatars packed, in their order; those that are trees are drawn with levels of detail. Packed
            here by default.
        coarseness: Levels of detail are chosen as if pixels were larger by this factor; 0 draws every Gaussian.

    Raises:
        ValueError: If the image is too large, or the numbers of avatars differ.
    """

    def __init__(
        self,
        scenes: PackedScene | ChunkTree | Sequence[PackedScene | ChunkTree],
        avatars: Sequence[Avatar],
        K_px: npt.ArrayLike,
        height_px: int,
        width_px: int,
        *,
        packed_avatars: Sequence[PackedAvatar | AvatarTree] | None = None,
        coarseness: float = COARSENESS,
    ) -> None:
        if max(height_px, width_px) > MAX_SIDE_PX:
            raise ValueError(f"images are limited to {MAX_SIDE_PX} px a side, got {height_px}x{width_px} px.")
        scenes = [scenes] if isinstance(scenes, PackedScene | ChunkTree) else scenes
        self._layers = [_Layer(*_with_cut(scene, coarseness)) for scene in scenes]
        self._scene_count = len(self._layers)
        packed = [pack_avatar(avatar) for avatar in avatars] if packed_avatars is None else packed_avatars
        if len(packed) != len(avatars):
            raise ValueError(f"packed_avatars must be as many as avatars, {len(avatars)}, got {len(packed)}.")
        self._avatars = [(avatar, *_avatar_with_cut(p, coarseness)) for avatar, p in zip(avatars, packed, strict=True)]
        self._people: list[_Person] = []
        self._K_px = np.asarray(K_px, dtype=np.float64)
        self._height, self._width = height_px, width_px
        self._ws = make_workspace(height_px, width_px)
        self._record_ends: list[int] = []

    def set_extra(self, cloud: GaussianCloud | None) -> None:
        """Draw a few more Gaussians with the scene, such as shadows, until they are set anew.

        Args:
            cloud: What to draw besides; None draws nothing more.
        """
        extra = [] if cloud is None else [_Layer(pack_sorted(cloud))]
        self._layers = [*self._layers[: self._scene_count], *extra]

    def render(self, T_world_camera: npt.ArrayLike, people: Sequence[PosedPerson] = ()) -> npt.NDArray[np.uint8]:
        """The image as bytes, sRGB for scenes trained on sRGB images.

        Args:
            T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
            people: People to draw.

        Returns:
            Shape (H, W, 3).

        Raises:
            ValueError: If the camera pose is not a finite 4x4 matrix.
        """
        self._draw(T_world_camera, people)
        return self._bytes()

    def _bytes(self) -> npt.NDArray[np.uint8]:
        rgb = np.empty((self._height, self._width, 3), dtype=np.uint8)
        cpu_blend.write_bytes(self._width, self._ws, rgb)
        return rgb

    def render_float(
        self, T_world_camera: npt.ArrayLike, people: Sequence[PosedPerson] = ()
    ) -> npt.NDArray[np.float32]:
        """The image before rounding, not clipped above 1, shape (H, W, 3); see `render`.

        Args:
            T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
            people: People to draw.
        """
        self._draw(T_world_camera, people)
        rgb = np.empty((self._height, self._width, 3), dtype=np.float32)
        cpu_blend.write_floats(self._width, self._ws, rgb)
        return rgb

    def render_images(
        self, T_world_camera: npt.ArrayLike, people: Sequence[PosedPerson] = (), outputs: Sequence[str] = ("rgb",)
    ) -> Images:
        """The image and others from the same pass; the colours have the bytes of `render`.

        Args:
            T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
            people: People to draw; the mask numbers them from 1 in this order.
            outputs: Names out of `readygo.common.images.images.OUTPUTS`; "rgb" is always made. Each new set of kinds of
                images (depths and mask; normals) is compiled when it is first asked for.

        Returns:
            The images.

        Raises:
            ValueError: If the camera pose is not a finite 4x4 matrix, a name is unknown, normals are wanted of a scene
                that was packed without, or a mask of more than 255 people.
        """
        wanted = require_outputs(outputs)
        if "normal" in wanted and any(layer.normal is None for layer in self._layers):
            raise ValueError("normals need scenes that were packed with them; pass normals=True when packing.")
        if "mask" in wanted and len(people) > MAX_PEOPLE:
            raise ValueError(f"a mask can tell {MAX_PEOPLE} people apart, got {len(people)}.")
        sums = Sums(self._depths if wanted - {"rgb", "alpha"} else None, self._normals if "normal" in wanted else None)
        self._draw(T_world_camera, people, sums)
        ids = [0] * len(self._layers) + list(range(1, len(people) + 1))
        instances = instance_of_records(self._record_ends, ids) if "mask" in wanted else None
        return write_images(wanted, self._bytes(), self._ws, sums, instances)

    @cached_property
    def _depths(self) -> Depths:
        return make_depths(self._height, self._width)

    @cached_property
    def _normals(self) -> npt.NDArray[np.float32]:
        return make_normals(self._height, self._width)

    def _draw(self, T_world_camera: npt.ArrayLike, people: Sequence[PosedPerson], sums: Sums = _RGB_ONLY) -> None:
        pose = np.asarray(T_world_camera, dtype=np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise ValueError(f"T_world_camera must be a finite 4x4 matrix, got {pose.tolist()}.")
        view = make_view(pose, self._K_px, self._height, self._width)
        layers = [*self._layers, *self._pose(people, view)]
        for layer in layers:
            layer.want_normals(sums.normals is not None)
        seen = [layer.cull(view) for layer in layers]
        ranges_m = [(chunks.depth_m.min(initial=np.inf), chunks.depth_m.max(initial=-np.inf)) for chunks in seen]
        self._ws = with_room(self._ws, records=CHUNK * sum(len(chunks.number) for chunks in seen))
        cpu_blend.begin_image(self._width, self._height, self._ws)
        self._record_ends.clear()
        sums.clear()
        slabs = slabs_of(np.concatenate([chunks.depth_m for chunks in seen]))
        for slab, next_limit_bits in zip(slabs, [*(slab.limit_bits for slab in slabs[1:]), FAR_BITS], strict=True):
            for layer, chunks, (nearest_m, farthest_m) in zip(layers, seen, ranges_m, strict=True):
                if nearest_m < slab.limit_m and farthest_m >= slab.first_m:
                    layer.project(view, chunks, slab, self._ws)
                self._record_ends.append(int(self._ws.counts[RECORDS]))
            # Each key meets up to four tiles, or all that its large box meets.
            counts = self._ws.counts
            self._ws = with_room(self._ws, entries=int(4 * counts[KEYS] + counts[LARGE_ENTRIES]))
            cpu_blend.draw_slab(self._width, next_limit_bits, self._ws, sums.depths, sums.normals)

    def _pose(self, people: Sequence[PosedPerson], view: View) -> list[_Layer]:
        """A layer per person; layers are kept for the next image."""
        for person in people[len(self._people) :]:
            self._people.append(_Person(*self._avatars[person.avatar]))
        layers: list[_Layer] = []
        for place, person in enumerate(people):
            avatar = self._avatars[person.avatar][0]
            if self._people[place].avatar is not avatar:
                self._people[place] = _Person(*self._avatars[person.avatar])
            self._people[place].pose(person, view)
            layers.append(self._people[place])
        return layers


def _cut(tree: ChunkTree | AvatarTree, coarseness: float) -> Cut:
    return Cut(_frozen(tree.skip), _frozen(tree.pixel_m), float(coarseness))


def _with_cut(scene: PackedScene | ChunkTree, coarseness: float) -> tuple[PackedScene, Cut | None]:
    return (scene.scene, _cut(scene, coarseness)) if isinstance(scene, ChunkTree) else (scene, None)


def _avatar_with_cut(packed: PackedAvatar | AvatarTree, coarseness: float) -> tuple[PackedAvatar, Cut | None]:
    return (packed.avatar, _cut(packed, coarseness)) if isinstance(packed, AvatarTree) else (packed, None)
