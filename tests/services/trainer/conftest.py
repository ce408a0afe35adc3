"""Synthetic episodes whose images tell the action."""

import dataclasses
from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.messages import EpisodeKey, Split
from readygo.common.messages.plan import DriverKind, Outcome
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import HUMAN, OBSTACLE, command_grid
from readygo.services.trainer import TrainConfig, with_overrides
from readygo.services.trainer.episodes import TrainingEpisode

AHEAD = 4


@dataclass
class FakeEpisode:
    episode: EpisodeKey
    first_sample: int
    sample_count: int
    sha256: str
    driver: DriverKind = DriverKind.EXPERT
    outcome: Outcome = Outcome.SUCCESS
    policy: str = ""
    drawn: dict = field(default_factory=dict)


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
    has_expert: bool = False
    has_risks: bool = False

    @property
    def truth(self):
        kinds = [("human_distance_m", np.float64), ("human_visible", np.bool_)]
        truth = np.zeros(len(self.actions), kinds)
        truth["human_distance_m"], truth["human_visible"] = np.inf, True
        return truth

    @property
    def expert_actions(self):
        return self.actions

    @property
    def expert_ahead(self):
        rows = np.arange(len(self.actions))
        return np.stack([self.actions[np.minimum(rows + k, rows[-1])] for k in range(1, AHEAD + 1)], axis=1)

    @property
    def risks(self):
        """Obstacles to the left, and a human ahead at every third sample."""
        speeds, turns = command_grid().T
        risks = np.tile(np.where((turns > 0) & (speeds > 0), OBSTACLE, 0), (len(self.actions), 1))
        risks[::3, (turns == 0) & (speeds == 1)] = HUMAN
        return risks.astype(np.uint8)

    @property
    def humans_xyzyaw(self):
        """One 2 m ahead, and another one."""
        x, y, _, yaw = self.poses.T
        ahead = np.stack([x + 2 * np.cos(yaw), y + 2 * np.sin(yaw), 0 * x, 0 * x], axis=1)
        return np.stack([ahead, ahead + 5], axis=1)

    def picture(self, index):
        height, width = self.camera.height_px, self.camera.width_px
        v, w = self.actions[index].tolist()
        image = np.full((height, width, 3), round(40 + 120 * v), np.uint8)
        column = round((0.5 - 0.4 * w / 1.2) * (width - 1))
        image[:, max(0, column - 2) : column + 3] = (255, 255, 0)
        return image

    def image(self, index):
        return png(self.picture(index))


def png(picture):
    return cv2.imencode(".png", picture[:, :, ::-1])[1].tobytes()


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
            FakeEpisode(
                EpisodeKey(seed=seed, split=Split.TRAIN, index=i), i * samples, samples, f"{name}-{seed}-episode-{i}"
            )
            for i in range(episodes)
        ],
        actions=actions,
        goals_xy_m=rng.uniform(-8, 8, (count, 2)).astype(np.float32),
        poses=rng.uniform(-3, 3, (count, 4)),
        robot=RobotConfig(camera=camera),
        content_hash=f"{name}-{seed}",
        camera=camera,
    )


def make_one(name="e", *, samples=40, size=100, **fields):
    """An episode of `samples` samples whose images have `size` bytes and cannot be decoded."""
    rng = np.random.default_rng(int.from_bytes(name.encode(), "big") % 2**32)
    numbers = {
        "actions": rng.uniform((0, -1), (1, 1), (samples, 2)).astype(np.float32),
        "goals_xy_m": rng.uniform(-8, 8, (samples, 2)).astype(np.float32),
        "xyyaw": rng.uniform(-3, 3, (samples, 3)),
    }
    return TrainingEpisode(name=name, images=tuple(bytes(size) for _ in range(samples)), **(numbers | fields))


@pytest.fixture
def make_data():
    return make_source


@pytest.fixture
def source():
    return make_source()


@pytest.fixture
def make_episode():
    return make_one


QUICK = with_overrides(
    TrainConfig(samples=640, threads=1, precision="fp32", validate_every=160),
    batch_size=32,
    shift_px=0,
    yaw_error_rad=0.0,
)


def quick(**settings):
    """`QUICK` with other settings."""
    return with_overrides(QUICK, **settings)


def forever(config):
    """The same without a budget in samples."""
    return dataclasses.replace(config, samples=None)
