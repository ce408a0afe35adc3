"""What comes out of a fit is an avatar that stands on the ground."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.export import (
    avatar_of_fit,
    lend_colours,
    unseen_shares,
    without_floaters,
)
from readygo.services.reconstructor.avatars.fit import PersonFit
from readygo.services.reconstructor.avatars.footage import read_footage
from readygo.services.reconstructor.avatars.views import read_person
from tests.services.reconstructor.avatars.conftest import trajectory_of


def test_unchanged_fit_gives_the_body_back(plain_film: Path, coarse_body: Avatar) -> None:
    footage = read_footage(plain_film)
    fit = PersonFit(coarse_body, read_person(footage, 96), trajectory_of(footage), AvatarFitConfig(steps=10))
    fit.rig.values["size"][0] = np.log(1.05)
    avatar, unseen = avatar_of_fit(fit, coarse_body, "again", "CC0")
    assert (avatar.name, avatar.license) == ("again", "CC0")
    assert avatar.height_m == pytest.approx(1.05 * coarse_body.height_m, rel=0.03)
    np.testing.assert_allclose(
        avatar.joints_tpose_m - avatar.joints_tpose_m[0],
        1.05 * (coarse_body.joints_tpose_m - coarse_body.joints_tpose_m[0]),
        atol=1e-4,
    )
    assert avatar.cloud.means_m[:, 1].min() == pytest.approx(0.0, abs=0.05)
    assert set(unseen) == {"head", "torso", "arms", "hands", "legs", "feet"}
    assert all(0.0 <= share <= 1.0 for share in unseen.values())


def test_hidden_gaussians_take_the_colours_of_their_neighbours() -> None:
    means = np.array([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [5, 0, 0], [5.1, 0, 0], [0.05, 0, 0]], np.float32)
    sh = np.array([[1, 1, 1], [1, 1, 1], [1, 1, 1], [1, 1, 1], [9, 9, 9], [7, 7, 7]], np.float32)
    seen = np.array([True, True, True, True, True, False])
    out = lend_colours(means, sh, seen)
    np.testing.assert_array_equal(out[:5], sh[:5])
    np.testing.assert_array_equal(out[5], [1, 1, 1])
    assert lend_colours(means, sh, np.ones(6, bool)) is sh


def test_shares_are_of_the_surface(coarse_body: Avatar) -> None:
    count = len(coarse_body.cloud)
    assert unseen_shares(coarse_body, np.ones(count, bool)) == dict.fromkeys(
        ("head", "torso", "arms", "hands", "legs", "feet"), 0.0
    )
    low = coarse_body.cloud.means_m[:, 1] > 0.2
    shares = unseen_shares(coarse_body, low)
    assert shares["feet"] > 0.9
    assert shares["head"] == 0.0


def test_floaters_are_left_out(coarse_body: Avatar) -> None:
    means = coarse_body.cloud.means_m.copy()
    means[0] = (3.0, 3.0, 3.0)
    stray = dataclasses.replace(coarse_body, cloud=dataclasses.replace(coarse_body.cloud, means_m=means))
    kept = without_floaters(stray, 1.0)
    assert len(kept.cloud) == len(stray.cloud) - 1
    assert len(kept.lbs_index) == len(kept.lbs_weight) == len(kept.cloud)
    assert without_floaters(coarse_body, 5.0) is coarse_body
