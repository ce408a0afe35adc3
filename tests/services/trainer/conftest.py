"""Synthetic episodes whose images tell the action."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.messages import EpisodeKey, Split
from readygo.common.robot import RobotConfig
from readygo.services.trainer import TrainConfig


@dataclass
class FakeEpisode:
    episode: EpisodeKey
    first_sample: int
    sample_count: int


@dataclass
class FakeSource:
    """Like `readygo.common.dataset.Dataset`: a bright bar's column tells w, the rows' brightness tells v."""

    episodes: list
    actions: np.ndarray
    goals_xy_m: np.ndarray
    poses: np.ndarray
    robot: RobotConfig | None
    content_hash: str
    camera: CameraConfig
    sensor: SensorConfig = field(default_factory=SensorConfig)
    decoded: int = 0

    def decode(self, index):
        self.decoded += 1
        height, width = self.camera.height_px, self.camera.width_px
        v, w = self.actions[index].tolist()
        image = np.full((height, width, 3), round(40 + 120 * v), np.uint8)
        column = round((0.5 - 0.4 * w / 1.2) * (width - 1))
        image[:, max(0, column - 2) : column + 3] = (255, 255, 0)
        return image


def make_source(*, episodes=6, samples=60, seed=0, camera=None, name="data"):
    camera = camera or CameraConfig(height_px=32, width_px=64)
    rng = np.random.default_rng(seed)
    count = episodes * samples
    steps = np.arange(samples) / 20
    actions = np.concatenate(
        [
            np.stack(
                [
                    0.5 + 0.4 * np.sin(rng.uniform(1, 3) * steps + rng.uniform(0, 6)),
                    1.1 * np.sin(rng.uniform(1, 3) * steps + rng.uniform(0, 6)),
                ],
                axis=1,
            )
            for _ in range(episodes)
        ]
    ).astype(np.float32)
    return FakeSource(
        episodes=[
            FakeEpisode(EpisodeKey(seed=seed, split=Split.TRAIN, index=i), i * samples, samples)
            for i in range(episodes)
        ],
        actions=actions,
        goals_xy_m=rng.uniform(-8, 8, (count, 2)).astype(np.float32),
        poses=rng.uniform(-3, 3, (count, 4)),
        robot=RobotConfig(camera=camera),
        content_hash=f"{name}-{seed}",
        camera=camera,
    )


@pytest.fixture
def make_data():
    return make_source


@pytest.fixture
def source():
    return make_source()


QUICK = TrainConfig(
    epochs=2,
    threads=1,
    batch_size=40,
    validate_every_steps=5,
    validation_samples=60,
    shift_px=0,
    mirror=0.0,
    yaw_error_rad=0.0,
)
