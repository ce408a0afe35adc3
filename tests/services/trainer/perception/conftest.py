"""Images in which a bright post stands where a human is, with what is to be told of them."""

import numpy as np
import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.perception.grid import polar_grid
from readygo.common.robot import RobotConfig
from readygo.services.trainer.perception.labels import PEOPLE_MAX, PerceptionLabels
from readygo.services.trainer.perception.looks import Looks

CAMERA = CameraConfig(height_px=72, width_px=128)
ROBOT = RobotConfig(camera=CAMERA)


def make_looks(count: int = 60, *, episodes: int = 6, seed: int = 0, camera: CameraConfig = CAMERA) -> Looks:
    """Posts at random bearings, as high as they are near; every third image shows none."""
    rng = np.random.default_rng(seed)
    height, width = camera.height_px, camera.width_px
    frames = np.full((count, height, width, 3), 40, np.uint8)
    people = np.full((count, PEOPLE_MAX, 4), np.nan, np.float32)
    visible = np.zeros((count, PEOPLE_MAX), np.bool_)
    focal = camera.K_px[0, 0]
    for row in range(count):
        if row % 3 == 0:
            continue
        bearing, distance_m = rng.uniform(-0.7, 0.7), rng.uniform(1.0, 5.0)
        u, half = width // 2 - focal * np.tan(bearing), max(focal * 0.25 / distance_m, 1)
        top = max(height // 2 - focal * 1.3 / distance_m, 0)
        frames[row, int(top) : 5 * height // 6, max(int(u - half), 0) : int(u + half) + 1] = (200, 180, 160)
        people[row, 0] = bearing, distance_m, 0.5, -0.5
        visible[row, 0] = True
    rows = np.arange(count)
    return Looks(
        frames=frames,
        window=np.stack([rows, rows, rows], axis=1),
        motion=np.zeros((count, 8), np.float32),
        labels=PerceptionLabels(
            people=people,
            visible=visible,
            rays_m=np.full((count, len(polar_grid(camera).bearings_rad)), 3.0, np.float32),
        ),
        episode=rows % episodes,
    )


@pytest.fixture
def looks() -> Looks:
    return make_looks()
