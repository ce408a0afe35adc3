"""A small film of a coarse avatar whose truth is known."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar
from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import View
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.services.reconstructor.avatars.config import PosePriorConfig
from readygo.services.reconstructor.avatars.footage import Footage, read_footage
from readygo.services.reconstructor.avatars.trajectory import PoseTrajectory, smoothed_trajectory
from readygo.services.reconstructor.avatars.views import FilmedPerson, read_person
from tests.common.avatars.coarse import coarse_avatar

FRAMES = 12
CONFIG = AvatarCaptureConfig(motion="turn", frames=FRAMES, width_px=96, height_px=96, pose_noise_deg=2.0)

GAIN, OFFSET = np.array([0.8, 0.7, 0.9]), np.array([20.0, 10.0, 5.0])
"""What makes the wall's colours those of the photos before it, in 0..255."""


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


@pytest.fixture(scope="session")
def wall() -> GaussianCloud:
    """Blobs of many colours behind the person of the film, who turns at (3, 0.95)."""
    rng, count = np.random.default_rng(0), 4000
    means = np.stack([rng.uniform(-3, 9, count), np.full(count, 2.5), rng.uniform(-3.0, 6.0, count)], axis=1)
    return GaussianCloud(
        means_m=means.astype(np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales_m=np.full((count, 3), 0.15, np.float32),
        opacities=np.full(count, 0.9, np.float32),
        sh=rng.uniform(-1.0, 1.0, (count, 1, 3)).astype(np.float32),
    )


@pytest.fixture
def filmed(plain_film: Path, wall: GaussianCloud) -> FilmedPerson:
    """The film before the wall, in other colours than the wall's Gaussians have."""
    person, photos = read_person(read_footage(plain_film), 96), []
    for number, rgb in enumerate(person.rgb):
        drawer = CpuRasterizer(pack_cloud(wall), {}, person.K_px[number], *rgb.shape[:2])
        behind = drawer.render([View(T_world_camera=person.T_world_camera[number], humans=())])[0].rgb
        changed = np.rint(GAIN * behind + OFFSET).astype(np.uint8)
        photos.append(np.where(person.mask[number][..., None], rgb, changed))
    return dataclasses.replace(person, rgb=tuple(photos))
