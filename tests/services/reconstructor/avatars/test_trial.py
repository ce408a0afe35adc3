"""A short fit tells which body suits a person."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.services.reconstructor.avatars import trial
from readygo.services.reconstructor.avatars.body import scale_body
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.fit import PersonFit
from readygo.services.reconstructor.avatars.footage import read_footage
from readygo.services.reconstructor.avatars.trial import choose_body
from tests.services.reconstructor.avatars.conftest import trajectory_of

CONFIG = AvatarFitConfig(steps=240, side_max_px=96)


def wide(body: Avatar) -> Avatar:
    """A body of very large Gaussians."""
    return dataclasses.replace(body, cloud=dataclasses.replace(body.cloud, scales_m=5.0 * body.cloud.scales_m))


def test_true_body_is_chosen_whatever_its_clothes(plain_film: Path, coarse_body: Avatar) -> None:
    footage, told = read_footage(plain_film), list[PersonFit]()
    small = scale_body(coarse_body, 0.9)
    negative = dataclasses.replace(small.cloud, sh=-small.cloud.sh)
    bodies = {
        "other": dataclasses.replace(wide(coarse_body), name="other"),
        "true": dataclasses.replace(small, cloud=negative, name="true"),
    }
    body, overlap = choose_body(bodies, footage, trajectory_of(footage), CONFIG, told.append)
    assert body.name == "true"
    assert body.height_m == pytest.approx(coarse_body.height_m, rel=0.1)
    assert overlap > 0.7
    assert [fit.step for fit in told] == [12, 12]


def test_one_body_and_hopeless_poses_are_not_tried(
    plain_film: Path, coarse_body: Avatar, monkeypatch: pytest.MonkeyPatch
) -> None:
    footage, told = read_footage(plain_film), list[PersonFit]()
    trajectory = trajectory_of(footage)
    alone, _ = choose_body({"one": coarse_body}, footage, trajectory, CONFIG, told.append)
    np.testing.assert_allclose(alone.height_m, coarse_body.height_m, rtol=0.1)
    monkeypatch.setattr(trial, "OVERLAP_MIN", 2.0)
    choose_body({"one": coarse_body, "two": wide(coarse_body)}, footage, trajectory, CONFIG, told.append)
    assert not told
