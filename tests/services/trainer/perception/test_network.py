import numpy as np
import torch

from readygo.common.camera.config import CameraConfig
from readygo.common.perception.artifact import FRAMES
from readygo.common.perception.grid import SHAPE, polar_grid
from readygo.common.perception.people import ACROSS_SD, BEARING, BEARING_SD, CHANNELS, DISTANCE, PRESENCE
from readygo.services.trainer.perception.network import PerceptionModule, PerceptionNet
from tests.services.trainer.perception.conftest import CAMERA

WIDTHS = (4, 4, 8, 8, 16)


def test_answers_have_the_shape_of_the_map() -> None:
    net = PerceptionNet(CAMERA, WIDTHS).eval()
    people, free = net(torch.zeros(2, 3 + FRAMES - 1, 72, 128), torch.zeros(2, 8))
    assert people.shape == (2, CHANNELS, *SHAPE)
    assert free.shape == (2, 2, SHAPE[1])


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
