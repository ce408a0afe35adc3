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
    """Draws with the CPU rasterizer."""

    def __init__(self, scene: Scene, avatars: Mapping[str, Avatar], camera: CameraConfig) -> None:
        warm()
        self._number = {name: number for number, name in enumerate(avatars)}
        self._rasterizer = CpuRasterizer(
            packed_layers(scene), list(avatars.values()), camera.K_px, camera.height_px, camera.width_px
        )

    def draw(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int) -> Image:
        """See `Drawing.draw`."""
        return self._rasterizer.render(T_world_camera, [self._posed(human, step) for human in humans])

    def draw_images(
        self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int, outputs: Sequence[str]
    ) -> Images:
        """See `Drawing.draw_images`."""
        return Images(rgb=self.draw(T_world_camera, humans, step))

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
        people = []
        for human in humans:
            motion = human.motion
            row = motion.row(step)
            people.append(pose_avatar(self._avatars[human.avatar], motion.root_m[row], motion.pose_axis_angle[row]))
        cloud = concatenate([self._cloud, *people]) if people else self._cloud
        camera = self._camera
        images = rasterize_reference(cloud, T_world_camera, camera.K_px, camera.height_px, camera.width_px)
        return (np.clip(images.rgb, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)

    def draw_images(
        self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int, outputs: Sequence[str]
    ) -> Images:
        """See `Drawing.draw_images`."""
        return Images(rgb=self.draw(T_world_camera, humans, step))


def packed_layers(scene: Scene) -> list[PackedScene]:
    """The scene and, if it has one, its sky; packed in the bundle's cache folder by whichever worker comes first."""
    names = [CLOUD_FILE, *([SKY_FILE] if SKY_FILE in scene.metadata["files"] else [])]
    return [_packed_layer(scene, name) for name in names]


def _packed_layer(scene: Scene, name: str) -> PackedScene:
    folder = scene.path / "cache" / f"packed-{scene.content_hash[:16]}-{Path(name).stem}"
    return load_or_pack(folder, lambda: load_gaussians(scene.path / name))
