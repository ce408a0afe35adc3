"""Plates are the scene from the film's cameras in the colours of the photos, and those of another place are refused."""

from dataclasses import replace

import numpy as np
import pytest

from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud
from readygo.services.reconstructor.avatars.plates import with_plates
from readygo.services.reconstructor.avatars.views import FilmedPerson
from tests.services.reconstructor.avatars.conftest import GAIN, OFFSET


def test_plates_look_like_the_photos_beside_the_person(filmed: FilmedPerson, wall: GaussianCloud) -> None:
    found = with_plates(filmed, [wall])
    assert found.plates is not None
    for plate, photo, mask in zip(found.plates, found.rgb, found.mask, strict=True):
        assert plate.shape == photo.shape
        assert np.abs(plate[~mask].astype(float) - photo[~mask]).max() <= 3.0
        assert np.abs(plate[mask].astype(float) - photo[mask]).mean() > 10.0
    assert "the scene looks like the photos to 6" in found.notes[-1]
    assert found.plate_colours is not None
    np.testing.assert_allclose(found.plate_colours[:, 0], np.tile(GAIN, (len(found), 1)), atol=0.01)
    np.testing.assert_allclose(255.0 * found.plate_colours[:, 1], np.tile(OFFSET, (len(found), 1)), atol=1.0)


def test_plates_of_another_place_are_refused(filmed: FilmedPerson, wall: GaussianCloud) -> None:
    moved = replace(wall, means_m=wall.means_m + np.float32([1.0, 0.0, 0.4]))
    with pytest.raises(AvatarError, match=r"unlike the photos \(\d+\.\d dB, with"):
        with_plates(filmed, [moved])
