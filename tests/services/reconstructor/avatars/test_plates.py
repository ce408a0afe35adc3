"""Plates are the scene from the film's cameras in the colours of the photos, and those of another place are refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import View
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.services.reconstructor.avatars.footage import read_footage
from readygo.services.reconstructor.avatars.plates import with_plates
from readygo.services.reconstructor.avatars.views import FilmedPerson, read_person

GAIN, OFFSET = np.array([0.8, 0.7, 0.9]), np.array([20.0, 10.0, 5.0])


@pytest.fixture(scope="module")
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
    return replace(person, rgb=tuple(photos))


def test_plates_look_like_the_photos_beside_the_person(filmed: FilmedPerson, wall: GaussianCloud) -> None:
    found = with_plates(filmed, [wall])
    assert found.plates is not None
    for plate, photo, mask in zip(found.plates, found.rgb, found.mask, strict=True):
        assert plate.shape == photo.shape
        assert np.abs(plate[~mask].astype(float) - photo[~mask]).max() <= 3.0
        assert np.abs(plate[mask].astype(float) - photo[mask]).mean() > 10.0
    assert "the scene looks like the photos to 6" in found.notes[-1]


def test_plates_of_another_place_are_refused(filmed: FilmedPerson, wall: GaussianCloud) -> None:
    moved = replace(wall, means_m=wall.means_m + np.float32([1.0, 0.0, 0.4]))
    with pytest.raises(AvatarError, match=r"unlike the photos \(\d+\.\d dB, with"):
        with_plates(filmed, [moved])
