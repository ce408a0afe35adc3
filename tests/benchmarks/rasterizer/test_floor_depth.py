import numpy as np
import pytest

from readygo.benchmarks.rasterizer.floor_depth import errors, floor_depths
from readygo.benchmarks.rasterizer.scenery import BenchScenery
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from readygo.common.robot import CameraConfig


def test_depth_of_free_level_floor_is_that_of_a_pinhole_camera() -> None:
    frame = GridFrame(origin_x_m=-1.0, origin_y_m=-4.0, resolution_m=0.05)
    occupied = np.zeros((160, 160), np.bool_)
    # What lies 2 m ahead hides the floor behind it.
    occupied[:, 60:62] = True
    floor = FloorMap(frame=frame, height_m=np.full((160, 160), 0.2, np.float32))
    occupancy = OccupancyMap(frame=frame, occupied=occupied)
    scenery = BenchScenery(name="", layers=list, cloud=lambda: None, occupancy=occupancy, floor=floor)
    camera = CameraConfig(height_px=72, width_px=128)
    found = floor_depths(scenery, camera, camera.T_world_camera(0.0, 0.0, 0.0, 0.2), 3.0)
    rows = np.arange(72) + 0.5 - camera.K_px[1, 2]
    true_m = camera.mount_height_m * camera.K_px[1, 1] / np.where(rows > 0, rows, np.nan)
    ahead = found[:, 64]
    assert np.isfinite(ahead).sum() > 5
    assert np.isfinite(ahead).tolist() == (true_m < 1.99 - camera.T_world_camera(0.0, 0.0, 0.0, 0.2)[0, 3]).tolist()
    np.testing.assert_allclose(ahead[np.isfinite(ahead)], true_m[np.isfinite(ahead)], rtol=1e-6)


def test_depth_that_is_nowhere_is_off() -> None:
    rates = errors(np.array([0.0, -0.2, 0.4, np.inf]))
    assert rates == {"pixels": 4, "off_10_percent": pytest.approx(75.0), "off_30_percent": pytest.approx(50.0)}
