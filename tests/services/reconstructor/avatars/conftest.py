"""A small film of a coarse avatar whose truth is known."""

import dataclasses
import shutil
from pathlib import Path

import pytest

from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar
from readygo.common.avatars import Avatar
from readygo.services.reconstructor.avatars.config import PosePriorConfig
from readygo.services.reconstructor.avatars.footage import Footage
from readygo.services.reconstructor.avatars.trajectory import PoseTrajectory, smoothed_trajectory
from tests.common.avatars.coarse import coarse_avatar

FRAMES = 12
CONFIG = AvatarCaptureConfig(motion="turn", frames=FRAMES, width_px=96, height_px=96, pose_noise_deg=2.0)


@pytest.fixture(scope="session")
def coarse_body() -> Avatar:
    """An embedded avatar of few, large Gaussians."""
    return coarse_avatar()


@pytest.fixture(scope="session")
def neuman_film(tmp_path_factory: pytest.TempPathFactory, coarse_body: Avatar) -> Path:
    """A film in NeuMan's layout; tests leave it as it is."""
    folder = tmp_path_factory.mktemp("film") / "neuman"
    capture_avatar(coarse_body, folder, CONFIG, lambda _: None)
    return folder


@pytest.fixture(scope="session")
def plain_film(tmp_path_factory: pytest.TempPathFactory, coarse_body: Avatar) -> Path:
    """The same film in the plain layout; tests leave it as it is."""
    folder = tmp_path_factory.mktemp("film") / "plain"
    capture_avatar(coarse_body, folder, dataclasses.replace(CONFIG, layout="plain"), lambda _: None)
    return folder


def trajectory_of(footage: Footage) -> PoseTrajectory:
    """The motion that given poses tell."""
    return smoothed_trajectory(footage.pose_axis_angle, footage.root_m, PosePriorConfig())


@pytest.fixture
def own_film(plain_film: Path, tmp_path: Path) -> Path:
    """A copy of the plain film to damage."""
    return Path(shutil.copytree(plain_film, tmp_path / "own"))
