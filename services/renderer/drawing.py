"""Drawing a scene with people in it, by the backend of the config."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from common.avatars import Avatar, pose_avatar
from common.gaussians import concatenate, load_gaussians
from common.messages import HumanMotion
from common.rasterizer.cpu import CpuRasterizer, PosedPerson
from common.rasterizer.images import Images
from common.rasterizer.packed import PackedScene, load_or_pack
from common.rasterizer.reference import rasterize_reference
from common.rasterizer.warm import warm
from common.robot import CameraConfig
from common.scenes import Scene
from common.scenes.scene import CLOUD_FILE, SKY_FILE

Image = npt.NDArray[np.uint8]
Pose = npt.NDArray[np.float64]


class Drawing(Protocol):
    """Makes images of one scene with one camera."""

    def draw(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int) -> Image:
        """The scene with `humans` at simulation step `step`, sRGB, shape (H, W, 3)."""
        ...

    def draw_images(
        self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int, outputs: Sequence[str]
    ) -> Images:
        """The same view as `draw`, with its other images in `outputs`; `rgb` has the bytes of `draw`."""
        ...


class CpuDrawing:
    """Draws with the CPU rasterizer; `outputs` are the images that will be asked for."""

    def __init__(
        self, scene: Scene, avatars: Mapping[str, Avatar], camera: CameraConfig, outputs: Sequence[str] = ("rgb",)
    ) -> None:
        warm(outputs)
        self._number = {name: number for number, name in enumerate(avatars)}
        layers = packed_layers(scene, normals="normal" in outputs)
        self._rasterizer = CpuRasterizer(layers, list(avatars.values()), camera.K_px, camera.height_px, camera.width_px)

    def draw(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int) -> Image:
        """See `Drawing.draw`."""
        return self._rasterizer.render(T_world_camera, [self._posed(human, step) for human in humans])

    def draw_images(
        self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int, outputs: Sequence[str]
    ) -> Images:
        """See `Drawing.draw_images`."""
        people = [self._posed(human, step) for human in humans]
        return self._rasterizer.render_images(T_world_camera, people, outputs)

    def _posed(self, human: HumanMotion, step: int) -> PosedPerson:
        motion = human.motion
        row = motion.row(step)
        return PosedPerson(
            avatar=self._number[human.avatar],
            root_m=motion.root_m[row],
            pose_axis_angle=motion.pose_axis_angle[row],
        )


class ReferenceDrawing:
    """Draws with the reference rasterizer."""

    def __init__(self, scene: Scene, avatars: Mapping[str, Avatar], camera: CameraConfig) -> None:
        self._cloud = scene.cloud if scene.sky is None else concatenate([scene.cloud, scene.sky])
        self._avatars, self._camera = avatars, camera

    def draw(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int) -> Image:
        """See `Drawing.draw`."""
        return self.draw_images(T_world_camera, humans, step, ("rgb",)).rgb

    def draw_images(
        self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int, outputs: Sequence[str]
    ) -> Images:
        """See `Drawing.draw_images`."""
        clouds = [self._cloud]
        for human in humans:
            motion = human.motion
            row = motion.row(step)
            clouds.append(pose_avatar(self._avatars[human.avatar], motion.root_m[row], motion.pose_axis_angle[row]))
        camera = self._camera
        images = rasterize_reference(
            concatenate(clouds) if humans else self._cloud,
            T_world_camera,
            camera.K_px,
            camera.height_px,
            camera.width_px,
            instances=np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds]),
        )
        return Images(
            rgb=(np.clip(images.rgb, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8),
            depth_m=images.depth_m if "depth" in outputs else None,
            median_depth_m=images.median_depth_m if "median_depth" in outputs else None,
            alpha=images.alpha if "alpha" in outputs else None,
            mask=images.mask if "mask" in outputs else None,
            normal=images.normal if "normal" in outputs else None,
        )


def packed_layers(scene: Scene, *, normals: bool = False) -> list[PackedScene]:
    """The scene and, if it has one, its sky; packed in the bundle's cache folder by whichever worker comes first."""
    names = [CLOUD_FILE, *([SKY_FILE] if SKY_FILE in scene.metadata["files"] else [])]
    return [_packed_layer(scene, name, normals=normals) for name in names]


def _packed_layer(scene: Scene, name: str, *, normals: bool) -> PackedScene:
    folder = scene.path / "cache" / f"packed-{scene.content_hash[:16]}-{Path(name).stem}"
    return load_or_pack(folder, lambda: load_gaussians(scene.path / name), normals=normals)
