import numpy as np
import pytest
import torch

from readygo.common.camera.config import CameraConfig
from readygo.common.perception.artifact import FRAMES
from readygo.common.perception.grid import SHAPE, polar_grid
from readygo.common.perception.people import ACROSS_SD, BEARING, BEARING_SD, CHANNELS, DISTANCE, PRESENCE
from readygo.services.trainer.perception.network import POOLED_HEIGHT_PX, PerceptionModule, PerceptionNet
from readygo.services.trainer.pooling import pooling_of
from tests.services.trainer.perception.conftest import CAMERA

WIDTHS = (4, 4, 8, 8, 16)


def test_answers_have_the_shape_of_the_map() -> None:
    net = PerceptionNet(CAMERA, WIDTHS).eval()
    people, free = net(torch.zeros(2, 3 + FRAMES - 1, 72, 128), torch.zeros(2, 8))
    assert people.shape == (2, CHANNELS, *SHAPE)
    assert free.shape == (2, 2, SHAPE[1])


@pytest.mark.parametrize(
    ("height_px", "width_px"),
    [(8, 8), (24, 32), (72, 125), (72, 128), (72, 129), (100, 100), (120, 160), (240, 320), (376, 672), (480, 848)],
)
def test_answers_have_the_shape_of_the_map_at_every_image_size(height_px: int, width_px: int) -> None:
    camera = CameraConfig(height_px=height_px, width_px=width_px)
    module = PerceptionModule(PerceptionNet(camera, WIDTHS).eval(), camera).eval()
    people, rays = module(torch.zeros(FRAMES, height_px, width_px, 3, dtype=torch.uint8), torch.zeros(1, 8))
    assert people.shape == (CHANNELS, *SHAPE)
    assert rays.shape == (2, SHAPE[1])


@pytest.mark.parametrize("width_px", [125, 128])
def test_columns_as_many_as_those_of_the_grid_are_read_as_they_are(width_px: int) -> None:
    torch.manual_seed(0)
    net = PerceptionNet(CameraConfig(height_px=72, width_px=width_px), WIDTHS).eval()
    shown, motion = torch.rand(2, 3 + FRAMES - 1, 72, width_px), torch.rand(2, 8)
    columns = net.neck(net.image(shown).flatten(1, 2)) + net.motion(motion * net.motion_scale)[:, :, None]
    assert torch.equal(net.features(shown, motion), net.columns(torch.relu(columns)))


def test_resampling_has_no_weights() -> None:
    plain, resampled = (PerceptionNet(CameraConfig(height_px=72, width_px=width), WIDTHS) for width in (128, 160))
    assert resampled.resampling is not None
    assert plain.state_dict().keys() == resampled.state_dict().keys()


def seen_px(camera: CameraConfig) -> np.ndarray:
    """Middle of what each column of a network sees, shape (32,) [px] of the camera's image, from its gradient.

    All weights of a convolution are equal, and blocks of columns only pass on, so what a column sees is symmetric
    about its middle where it does not reach the edge of the image.
    """
    net = PerceptionNet(camera, WIDTHS).double().eval()
    for module in net.image.modules():
        if isinstance(module, torch.nn.Conv2d):
            torch.nn.init.constant_(module.weight, 1.0 / module.weight[0].numel())
    torch.nn.init.constant_(net.neck.weight, 1.0)
    for parameter in net.columns.parameters():
        torch.nn.init.zeros_(parameter)
    pooling = pooling_of(camera, POOLED_HEIGHT_PX)
    shape = 3 + FRAMES - 1, camera.height_px // pooling, camera.width_px // pooling
    shown = torch.ones(1, *shape, dtype=torch.float64, requires_grad=True)
    features = net.features(shown, torch.zeros(1, 8, dtype=torch.float64))
    middles = []
    for column in range(SHAPE[1]):
        (gradient,) = torch.autograd.grad(features[0, :, column].sum(), shown, retain_graph=True)
        across = gradient.sum(dim=(0, 1, 2)).numpy()
        middles.append(pooling * (np.arange(shape[2]) + 0.5) @ across / across.sum())
    return np.array(middles)


@pytest.mark.parametrize(
    ("height_px", "width_px"), [(72, 161), (120, 160), (240, 320), (376, 672), (480, 848), (24, 100), (72, 180)]
)
def test_columns_look_at_the_bearings_of_the_grid(height_px: int, width_px: int) -> None:
    camera = CameraConfig(height_px=height_px, width_px=width_px)
    px = seen_px(camera)
    ray = (px - camera.K_px[0, 2]) / camera.K_px[0, 0]
    reach_px = 40 * pooling_of(camera, POOLED_HEIGHT_PX)
    inner = (px > reach_px) & (px < width_px - reach_px)
    assert inner.sum() >= 6
    np.testing.assert_allclose(-np.arctan(ray)[inner], polar_grid(camera).bearings_rad[inner], atol=1e-6)


def picture(camera: CameraConfig, yaw: float) -> torch.Tensor:
    """A pole of light 0.3 rad to the left of the world's x axis, seen by a robot that is turned by `yaw`."""
    grey = torch.zeros(1, 1, camera.height_px, camera.width_px)
    ray = np.array([np.cos(0.3 - yaw), np.sin(0.3 - yaw), 0.0]) @ camera.T_world_camera(0.0, 0.0, 0.0, 0.0)[:3, :3]
    u = camera.K_px[0, 0] * ray[0] / ray[2] + camera.K_px[0, 2]
    grey[..., round(u) - 2 : round(u) + 3] = 1.0
    return grey


def test_older_frames_are_turned_to_the_present_heading() -> None:
    for camera in (CAMERA, CameraConfig(height_px=72, width_px=128, mount_pitch_deg=10.0)):
        net = PerceptionNet(camera, WIDTHS)
        now, before = picture(camera, 0.0), picture(camera, -0.2)
        # The robot turned left by 0.2 rad since then: its heading then was 0.2 rad to the right.
        turned = net.turned(before, torch.tensor([-0.2]))
        middle = slice(30, 42)
        assert (before - now)[:, :, middle].abs().mean() > 0.05
        assert (turned - now)[:, :, middle].abs().mean() < 0.015


def test_frames_that_agree_leave_no_difference() -> None:
    net = PerceptionNet(CAMERA, WIDTHS)
    newest = torch.rand(1, 3, 72, 128)
    grey = newest.mean(dim=1, keepdim=True).repeat(1, FRAMES, 1, 1)
    shown = net.stack(newest, grey, torch.zeros(1, 8))
    assert shown.shape == (1, 5, 72, 128)
    torch.testing.assert_close(shown[:, :3], newest * 2 - 1)
    assert shown[:, 3:].abs().max() < 1e-4


def test_exported_module_tells_cells_in_units_of_the_world() -> None:
    net = PerceptionNet(CAMERA, WIDTHS).eval()
    module, grid = PerceptionModule(net, CAMERA).eval(), polar_grid(CAMERA)
    told, free = module.decoded(torch.zeros(1, CHANNELS, *SHAPE), torch.zeros(1, 2, SHAPE[1]))
    assert torch.all(told[0, PRESENCE] == 0.5)
    np.testing.assert_allclose(told[0, BEARING], np.broadcast_to(grid.bearings_rad, SHAPE), atol=1e-6)
    np.testing.assert_allclose(told[0, DISTANCE][:, 0], grid.distances_m, rtol=1e-5)
    assert torch.all(told[0, BEARING_SD : ACROSS_SD + 1] == 1.0)
    assert torch.all(free == 1.0)
    people, rays = module(torch.zeros(FRAMES, 72, 128, 3, dtype=torch.uint8), torch.zeros(1, 8))
    assert people.shape == (CHANNELS, *SHAPE)
    assert rays.shape == (2, SHAPE[1])
