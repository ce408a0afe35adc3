"""What the GPU rasterizer does around its kernels; what its images show: see test_interface.py."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.errors import AvatarError, ReadygoError  # noqa: E402
from readygo.common.rasterizer.gpu import gsplat_kernels  # noqa: E402
from readygo.common.rasterizer.gpu import rasterizer as gpu_rasterizer  # noqa: E402
from readygo.common.rasterizer.gpu.device_images import DeviceImages  # noqa: E402
from readygo.common.rasterizer.gpu.rasterizer import GpuRasterizer  # noqa: E402
from readygo.common.rasterizer.interface import View  # noqa: E402
from tests.common.rasterizer.drawing import batch_of, float_rgb_of, numbered, rgb_of  # noqa: E402
from tests.common.rasterizer.gpu.reference_rasterization import ReferenceRasterization, stand_in_for_gsplat  # noqa: E402

HEIGHT, WIDTH = 24, 32


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> ReferenceRasterization:
    return stand_in_for_gsplat(monkeypatch)


@pytest.fixture
def K_px(camera) -> np.ndarray:
    return camera(0, 0, 0, WIDTH, HEIGHT)[1]


def test_unknown_kernels_are_refused(make_cloud, K_px) -> None:
    with pytest.raises(ValueError, match="kernels"):
        GpuRasterizer(make_cloud(5), {}, K_px, HEIGHT, WIDTH, kernels="vulkan", device="cpu")


def test_images_on_the_device_are_those_that_reach_the_host(make_cloud, camera, K_px, drawn) -> None:
    rasterizer = GpuRasterizer(make_cloud(60), {}, K_px, HEIGHT, WIDTH, kernels="gsplat", device="cpu")
    poses = [camera(-4.0, 0.3 * k, 0.0, WIDTH, HEIGHT)[0] for k in range(2)]
    views = batch_of(poses, [[], []])
    images = rasterizer.render_on_device(views)
    assert isinstance(images, torch.Tensor)
    assert np.array_equal(images.numpy(), rasterizer.render(views).rgb)
    floats = float_rgb_of(rasterizer, poses[1])
    assert floats.max() > 0.3
    assert np.abs(np.clip(floats, 0, 1) * 255 - images[1].numpy()).max() <= 0.51


def test_several_clouds_are_drawn_as_one(make_cloud, camera, K_px, drawn) -> None:
    one, two = make_cloud(40), make_cloud(30, seed=1)
    rasterizer = GpuRasterizer([one, two], {}, K_px, HEIGHT, WIDTH, kernels="gsplat", device="cpu")
    rgb_of(rasterizer, camera(-4.0, 0.0, 0.0, WIDTH, HEIGHT)[0])
    visible = sum(int((cloud.opacities >= np.float32(1 / 255)).sum()) for cloud in (one, two))
    assert len(drawn.calls[0]["means"]) == visible


def test_avatars_are_numbered_by_name(make_cloud, camera, small_avatar, human, K_px, drawn) -> None:
    avatars = numbered([small_avatar, small_avatar])
    rasterizer = GpuRasterizer(make_cloud(5), avatars, K_px, HEIGHT, WIDTH, kernels="gsplat", device="cpu")
    T = camera(-4.0, 0.0, 0.0, WIDTH, HEIGHT)[0]
    assert np.array_equal(
        rgb_of(rasterizer, T, [human(-2.0, 0.0)]), rgb_of(rasterizer, T, [human(-2.0, 0.0, avatar=1)])
    )
    with pytest.raises(AvatarError, match="'2' is not loaded"):
        rasterizer.render_on_device([View(T_world_camera=T, humans=[human(-2.0, 0.0, avatar=2)])])


def test_shadows_are_refused_on_the_device_as_well(make_cloud, camera, K_px, drawn) -> None:
    rasterizer = GpuRasterizer(make_cloud(5), {}, K_px, HEIGHT, WIDTH, kernels="gsplat", device="cpu")
    T = camera(-4.0, 0.0, 0.0, WIDTH, HEIGHT)[0]
    with pytest.raises(ReadygoError, match="draw no shadows; use the cpu backend"):
        rasterizer.render_on_device([View(T_world_camera=T, shadows=make_cloud(2))])


class RedKernels:
    """Stands in for kernels on any device: red images, of as many views as it is given."""

    def __init__(self, *_: object) -> None:
        self.current, self.sizes = list(ON), []

    def draw(self, batch: list[View], wanted: frozenset[str]) -> DeviceImages:
        self.current, self.sizes = list(ON), [*self.sizes, len(batch)]
        rgb = torch.zeros((len(batch), HEIGHT, WIDTH, 3))
        rgb[..., 0] = 1.0
        return DeviceImages(rgb=rgb, alpha=rgb[..., 0])


ON: list[object] = []
"""Devices that are current, as the stand-in for CUDA knows them."""


@pytest.fixture
def red(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels that need no GPU, and a CUDA that remembers its current device."""

    @contextmanager
    def current(device: object) -> Iterator[None]:
        ON.append(str(device))
        yield
        ON.pop()

    monkeypatch.setattr(gsplat_kernels, "GsplatKernels", RedKernels)
    monkeypatch.setattr(gpu_rasterizer, "require_kernels", lambda kernels, device: None)
    monkeypatch.setattr(gpu_rasterizer, "make_batch", lambda views, numbers, device: views)
    monkeypatch.setattr(torch.cuda, "device", current)


@pytest.mark.parametrize(("device", "current"), [("cuda:1", ["cuda:1"]), ("cpu", [])])
def test_kernels_are_loaded_and_launched_on_the_device_that_is_asked_for(red, K_px, device: str, current) -> None:
    rasterizer = GpuRasterizer([], {}, K_px, HEIGHT, WIDTH, kernels="gsplat", device=device)
    assert rasterizer._kernels.current == current
    rasterizer._kernels.current = []
    rasterizer.render([View(T_world_camera=np.eye(4))])
    assert rasterizer._kernels.current == current
    assert ON == []


@pytest.mark.parametrize(
    ("size_px", "views"), [((24, 32), 64), ((144, 256), 64), ((720, 1280), 18), ((4095, 4095), 1), ((8160, 8160), 1)]
)
def test_fewer_views_of_larger_images_are_drawn_together(red, K_px, size_px: tuple[int, int], views: int) -> None:
    rasterizer = GpuRasterizer([], {}, K_px, *size_px, kernels="gsplat", device="cpu")
    assert rasterizer.views_at_once == views


def test_views_beyond_the_memory_are_drawn_in_parts(red, K_px, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu_rasterizer, "PIXELS_AT_ONCE", 3 * HEIGHT * WIDTH)
    rasterizer = GpuRasterizer([], {}, K_px, HEIGHT, WIDTH, kernels="gsplat", device="cpu")
    views = [View(T_world_camera=np.eye(4))] * 7
    images = rasterizer.render(views, ("alpha",))
    assert rasterizer._kernels.sizes == [3, 3, 1]
    assert images.rgb.shape == (7, HEIGHT, WIDTH, 3)
    assert (images.rgb == (255, 0, 0)).all()
    assert images.alpha is not None
    assert (images.alpha == 1.0).all()
    assert np.array_equal(rasterizer.render_on_device(views).numpy(), images.rgb)
