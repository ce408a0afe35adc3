"""Drawing a scene with people in it on a GPU."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from readygo.common.avatars import Avatar
from readygo.common.images.images import Images
from readygo.common.messages import HumanMotion
from readygo.common.rasterizer.cpu.rasterizer import PosedPerson
from readygo.common.rasterizer.gpu.availability import require_kernels
from readygo.common.scenes import Scene
from readygo.services.renderer.drawing import PinholeCamera
from readygo.services.renderer.sensor.motion import posed

Image = npt.NDArray[np.uint8]
Pose = npt.NDArray[np.float64]


class GpuDrawing:
    """Draws with the GPU rasterizer; see `services.renderer.drawing.Drawing`.

    Args:
        scene: Scene bundle.
        avatars: Who may be drawn, by name.
        camera: Camera.
        kernels: "triton" or "gsplat".
        device: CUDA device.

    Raises:
        ReadygoError: If a package, a GPU or a compiler is missing.
    """

    def __init__(
        self,
        scene: Scene,
        avatars: Mapping[str, Avatar],
        camera: PinholeCamera,
        kernels: str = "triton",
        device: str = "cuda",
    ) -> None:
        require_kernels(kernels, device)
        # torch takes seconds to load; this module does not.
        from readygo.common.rasterizer.gpu.rasterizer import GpuRasterizer

        self._number = {name: number for number, name in enumerate(avatars)}
        clouds = [scene.cloud] if scene.sky is None else [scene.cloud, scene.sky]
        self._rasterizer = GpuRasterizer(
            clouds,
            list(avatars.values()),
            camera.K_px,
            camera.height_px,
            camera.width_px,
            kernels=kernels,
            device=device,
        )

    def draw(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float) -> Image:
        """See `Drawing.draw`."""
        return self._rasterizer.render(T_world_camera, self._people(humans, step))

    def draw_images(
        self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: float, outputs: Sequence[str]
    ) -> Images:
        """See `Drawing.draw_images`."""
        return self._rasterizer.render_images(T_world_camera, self._people(humans, step), outputs)

    def _people(self, humans: Sequence[HumanMotion], step: float) -> list[PosedPerson]:
        return [
            PosedPerson(avatar=self._number[one.avatar], root_m=one.root_m, pose_axis_angle=one.pose_axis_angle)
            for one in posed(humans, step)
        ]
