"""Drawing a scene with people in it, by the backend of the config."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from readygo.common.avatars import Avatar, pose_avatar
from readygo.common.avatars.file import avatar_hash
from readygo.common.gaussians import GaussianCloud, concatenate, load_gaussians
from readygo.common.images.images import Images, require_outputs
from readygo.common.messages import HumanMotion
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer, PosedPerson
from readygo.common.rasterizer.lod.avatar import AvatarTree
from readygo.common.rasterizer.lod.files import load_or_build_avatar_tree, load_or_build_tree, load_or_pack_avatar
from readygo.common.rasterizer.lod.tree import ChunkTree
from readygo.common.rasterizer.packed.avatar import PackedAvatar
from readygo.common.rasterizer.packed.scene import PackedScene, load_or_pack
from readygo.common.rasterizer.reference import ReferenceImages, rasterize_reference
from readygo.common.rasterizer.warm import warm
from readygo.common.scenes import Scene
from readygo.common.scenes.scene import CLOUD_FILE, SKY_FILE
from readygo.services.renderer.sensor.motion import PosedHuman, posed

Image = npt.NDArray[np.uint8]
Pose = npt.NDArray[np.float64]


FIELDS = {"depth": "depth_m", "median_depth": "median_depth_m"}
"""Fields of `Images` whose names are not those of the outputs."""
Shadows = Callable[[Sequence[PosedHuman], Pose], GaussianCloud | None]
"""Makes the shadows of people for a camera centre [m], shape (3,)."""


class PinholeCamera(Protocol):
    """A pinhole camera; `CameraConfig` is one."""

    @property
    def K_px(self) -> Pose:
        """Intrinsics [px], shape (3, 3)."""
        ...

    @property
    def height_px(self) -> int:
        """Image height."""
        ...

    @property
    def width_px(self) -> int:
        """Image width."""
        ...


class Drawing(Protocol):
    """Makes images of one scene with one pinhole camera."""

    def draw(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float) -> Image:
        """The scene with `humans` at simulation step `step`, sRGB, shape (H, W, 3)."""
        ...

    def draw_images(
        self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float, outputs: Sequence[str]
    ) -> Images:
        """The same view as `draw`, with its other images in `outputs`; `rgb` has the bytes of `draw`."""
        ...


class CpuDrawing:
    """Draws with the CPU rasterizer.

    Args:
        scene: The scene bundle.
        avatars: Avatars by name.
        camera: The pinhole camera.
        outputs: Images that will be asked for.
        detail: "exact", or "lod" for levels of detail.
        shadows: None leaves people without shadows.
    """

    def __init__(
        self,
        scene: Scene,
        avatars: Mapping[str, Avatar],
        camera: PinholeCamera,
        outputs: Sequence[str] = ("rgb",),
        *,
        detail: str = "exact",
        shadows: Shadows | None = None,
    ) -> None:
        warm(outputs)
        self._shadows = shadows
        self._number = {name: number for number, name in enumerate(avatars)}
        layers = (packed_layers if detail == "exact" else lod_layers)(scene, normals="normal" in outputs)
        packed = [packed_avatar(scene, avatar, detail) for avatar in avatars.values()]
        people = [avatar.skeleton() for avatar in avatars.values()]
        size = camera.height_px, camera.width_px
        self._rasterizer = CpuRasterizer(layers, people, camera.K_px, *size, packed_avatars=packed)

    def draw(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float) -> Image:
        """See `Drawing.draw`."""
        return self._rasterizer.render(T_world_camera, self._people(T_world_camera, humans, step))

    def draw_images(
        self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float, outputs: Sequence[str]
    ) -> Images:
        """See `Drawing.draw_images`."""
        people = self._people(T_world_camera, humans, step)
        if self._shadows is None:
            return self._rasterizer.render_images(T_world_camera, people, outputs)
        rgb = self._rasterizer.render(T_world_camera, people)
        if set(outputs) <= {"rgb"}:
            return Images(rgb=rgb)
        # Shadows are pulled towards the camera: they belong to the colours only.
        self._rasterizer.set_extra(None)
        return dataclasses.replace(self._rasterizer.render_images(T_world_camera, people, outputs), rgb=rgb)

    def _people(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float) -> list[PosedPerson]:
        """The people to draw; their shadows are laid out."""
        people = posed(humans, step)
        if self._shadows is not None:
            self._rasterizer.set_extra(self._shadows(people, T_world_camera[:3, 3]))
        return [
            PosedPerson(avatar=self._number[one.avatar], root_m=one.root_m, pose_axis_angle=one.pose_axis_angle)
            for one in people
        ]


class ReferenceDrawing:
    """Draws with the reference rasterizer; arguments as of `CpuDrawing`."""

    def __init__(
        self, scene: Scene, avatars: Mapping[str, Avatar], camera: PinholeCamera, *, shadows: Shadows | None = None
    ) -> None:
        self._cloud = scene.cloud if scene.sky is None else concatenate([scene.cloud, scene.sky])
        self._avatars, self._camera, self._shadows = avatars, camera, shadows

    def draw(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float) -> Image:
        """See `Drawing.draw`."""
        people = posed(humans, step)
        shadows = self._shadows(people, T_world_camera[:3, 3]) if self._shadows is not None else None
        rgb = self._rasterized(T_world_camera, people, [] if shadows is None else [shadows]).rgb
        return (np.clip(rgb, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)

    def draw_images(
        self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float, outputs: Sequence[str]
    ) -> Images:
        """See `Drawing.draw_images`."""
        images = Images(rgb=self.draw(T_world_camera, humans, step))
        names = {name: FIELDS.get(name, name) for name in require_outputs(outputs) - {"rgb"}}
        if not names:
            return images
        drawn = self._rasterized(T_world_camera, posed(humans, step), [])
        return dataclasses.replace(images, **{name: getattr(drawn, name) for name in names.values()})

    def _rasterized(
        self, T_world_camera: Pose, people: Sequence[PosedHuman], others: Sequence[GaussianCloud]
    ) -> ReferenceImages:
        clouds = [pose_avatar(self._avatars[one.avatar], one.root_m, one.pose_axis_angle) for one in people]
        clouds = [self._cloud, *clouds, *others]
        numbers = [0, *range(1, len(people) + 1), *(0 for _ in others)]
        instances = np.repeat(np.array(numbers, dtype=np.uint8), [len(cloud) for cloud in clouds])
        cloud, camera = concatenate(clouds), self._camera
        return rasterize_reference(
            cloud, T_world_camera, camera.K_px, camera.height_px, camera.width_px, instances=instances
        )


def packed_layers(scene: Scene, *, normals: bool = False) -> list[PackedScene]:
    """The scene and, if it has one, its sky; packed in the bundle's cache folder by whichever worker comes first."""
    return [_packed_layer(scene, name, normals=normals) for name in _layer_files(scene)]


def lod_layers(scene: Scene, *, normals: bool = False) -> list[ChunkTree]:
    """As `packed_layers`, with levels of detail; the first worker takes about 30 s per million Gaussians."""

    def layer(name: str) -> ChunkTree:
        folder = scene.path / "cache" / f"lod-{scene.content_hash[:16]}-{Path(name).stem}"
        return load_or_build_tree(folder, lambda: _packed_layer(scene, name, normals=normals), normals=normals)

    return [layer(name) for name in _layer_files(scene)]


def packed_avatar(scene: Scene, avatar: Avatar, detail: str = "exact") -> PackedAvatar | AvatarTree:
    """A packed avatar, kept in the scene's cache folder; with levels of detail if `detail` is "lod"."""
    folder = scene.path / "cache" / f"avatar-{avatar_hash(avatar)[:16]}-{detail}"
    return load_or_build_avatar_tree(folder, avatar) if detail == "lod" else load_or_pack_avatar(folder, avatar)


def _layer_files(scene: Scene) -> list[str]:
    return [CLOUD_FILE, *([SKY_FILE] if SKY_FILE in scene.metadata["files"] else [])]


def _packed_layer(scene: Scene, name: str, *, normals: bool) -> PackedScene:
    folder = scene.path / "cache" / f"packed-{scene.content_hash[:16]}-{Path(name).stem}"
    return load_or_pack(folder, lambda: load_gaussians(scene.path / name), normals=normals)
