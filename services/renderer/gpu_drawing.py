"""Drawing a scene with people in it on a GPU."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from common.avatars import Avatar
from common.messages import HumanMotion
from common.rasterizer.cpu import PosedPerson
from common.rasterizer.gpu.availability import require_kernels
from common.robot import CameraConfig
from common.scenes import Scene

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
        camera: CameraConfig,
        kernels: str = "triton",
        device: str = "cuda",
    ) -> None:
        require_kernels(kernels, device)
        # torch takes seconds to load; this module does not.
        from common.rasterizer.gpu.rasterizer import GpuRasterizer

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

    def draw(self, T_world_camera: Pose, humans: Sequence[HumanMotion], step: int) -> Image:
        """See `Drawing.draw`."""
        return self._rasterizer.render(T_world_camera, self._posed(humans, step))

    def draw_batch(
        self, T_world_camera: Pose, humans: Sequence[Sequence[HumanMotion]], steps: Sequence[int]
    ) -> npt.NDArray[np.uint8]:
        """Many views in one call.

        Args:
            T_world_camera: Camera poses, OpenCV axes, shape (B, 4, 4).
            humans: People that each camera sees, B sequences.
            steps: Simulation step of each view.

        Returns:
            sRGB, shape (B, H, W, 3).
        """
        people = [self._posed(group, step) for group, step in zip(humans, steps, strict=True)]
        return self._rasterizer.render_batch(T_world_camera, people)

    def _posed(self, humans: Sequence[HumanMotion], step: int) -> list[PosedPerson]:
        people = []
        for human in humans:
            row = human.motion.row(step)
            people.append(
                PosedPerson(
                    avatar=self._number[human.avatar],
                    root_m=human.motion.root_m[row],
                    pose_axis_angle=human.motion.pose_axis_angle[row],
                )
            )
        return people
