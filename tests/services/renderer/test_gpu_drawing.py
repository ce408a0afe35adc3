import importlib.util

import numpy as np
import pytest

from readygo.common.errors import ReadygoError
from readygo.common.messages import HumanMotion, Motion
from readygo.common.robot import CameraConfig
from readygo.services.renderer.drawing import ReferenceDrawing
from readygo.services.renderer.gpu_drawing import GpuDrawing

CAMERA = CameraConfig(height_px=24, width_px=32)


class ReferenceKernels:
    """Stands in for a GPU: draws the clouds that it is given one view at a time."""

    def __init__(self, scenes, avatars, K_px, height_px, width_px, *, kernels, device) -> None:
        self.scenes, self.avatars, self.lens, self.kernels = scenes, avatars, (K_px, height_px, width_px), kernels

    def render(self, T_world_camera, people):
        from readygo.common.avatars import pose_avatar
        from readygo.common.gaussians import concatenate
        from readygo.common.rasterizer.reference import rasterize_reference

        bodies = [pose_avatar(self.avatars[p.avatar], p.root_m, p.pose_axis_angle) for p in people]
        rgb = rasterize_reference(concatenate([*self.scenes, *bodies]), T_world_camera, *self.lens).rgb
        return (np.clip(rgb, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def walker(avatars, x_m: float) -> HumanMotion:
    root = np.array([[x_m, 0.1 * step, 0.95] for step in range(5)], dtype=np.float32)
    pose = 0.1 * np.random.default_rng(0).normal(size=(5, 24, 3)).astype(np.float32)
    return HumanMotion(avatar=sorted(avatars)[-1], motion=Motion(root_m=root, pose_axis_angle=pose))


def test_scene_sky_and_people_are_drawn_as_by_the_reference(scene, avatars, monkeypatch: pytest.MonkeyPatch) -> None:
    rasterizer = pytest.importorskip("readygo.common.rasterizer.gpu.rasterizer", reason="torch is not installed")
    monkeypatch.setattr("readygo.services.renderer.gpu_drawing.require_kernels", lambda kernels, device: None)
    monkeypatch.setattr(rasterizer, "GpuRasterizer", ReferenceKernels)
    drawing, reference = GpuDrawing(scene, avatars, CAMERA), ReferenceDrawing(scene, avatars, CAMERA)
    T = CAMERA.T_world_camera(0.0, 0.0, 0.3, 0.0)
    humans = [walker(avatars, 2.5)]
    image = drawing.draw(T, humans, 3)
    assert np.array_equal(image, reference.draw(T, humans, 3))
    assert not np.array_equal(image, drawing.draw(T, humans, 0))


def test_machine_without_a_gpu_is_told_so(scene, avatars) -> None:
    if importlib.util.find_spec("torch") and importlib.import_module("torch").cuda.is_available():
        pytest.skip("this machine has a GPU")
    with pytest.raises(ReadygoError, match=r"readygo\[gpu\]|CUDA device"):
        GpuDrawing(scene, avatars, CAMERA, kernels="gsplat")
