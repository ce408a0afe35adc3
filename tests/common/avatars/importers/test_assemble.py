import dataclasses
from typing import Any

import numpy as np
import pytest

from readygo.common.arrays import Float64Array
from readygo.common.avatars.importers.assemble import CanonicalHuman, assemble_avatar, scale_to_metres, strongest_four
from readygo.common.avatars.importers.joints import JOINT
from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud
from tests.common.avatars.importers.humans import boxes, tpose_joints_m


def human(unit: float = 1.0, lift: float = 0.0) -> CanonicalHuman:
    """A Gaussian at each vertex of the boxes, in a unit of which a metre has `unit`, `lift` above the ground."""
    vertices, _, owners, _ = boxes()
    count = len(vertices)
    return CanonicalHuman(
        cloud=GaussianCloud(
            means_m=(unit * vertices + (0.0, lift, 0.0)).astype(np.float32),
            quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
            scales_m=np.full((count, 3), 0.01 * unit, np.float32),
            opacities=np.ones(count, np.float32),
            sh=np.zeros((count, 1, 3), np.float32),
        ),
        weights=np.eye(24)[owners],
        joints=unit * tpose_joints_m() + (0.0, lift, 0.0),
        R_tpose_canonical=np.tile(np.eye(3), (24, 1, 1)),
    )


def test_human_in_centimetres_above_the_ground_comes_down_in_metres() -> None:
    avatar, scale = assemble_avatar(human(unit=100.0, lift=40.0), name="ann", license_text="CC0", height_m=1.75)
    assert scale == pytest.approx(0.01, rel=1e-3)
    assert (avatar.name, avatar.license, avatar.height_m) == ("ann", "CC0", 1.75)
    assert avatar.cloud.means_m[:, 1].min() == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(avatar.joints_tpose_m, tpose_joints_m(), atol=2e-3)
    np.testing.assert_allclose(avatar.joints_canonical_m, avatar.joints_tpose_m, atol=1e-6)
    np.testing.assert_allclose(avatar.cloud.scales_m, 0.01, rtol=1e-3)


def test_faint_floaters_do_not_make_a_giant() -> None:
    floating = human()
    floating.cloud.means_m[:5, 1] = 9.0
    floating.cloud.opacities[:5] = 0.1
    assert assemble_avatar(floating, name="a", license_text="")[0].height_m == pytest.approx(1.75, abs=0.01)


def test_given_height_or_the_metre_decides_the_scale() -> None:
    assert scale_to_metres(1.6, None) == 1.0
    assert scale_to_metres(160.0, 1.8) == pytest.approx(1.8 / 160.0)
    for height, height_m, words in ((160.0, None, "160 m tall"), (1.6, 3.0, "--height-m"), (0.0, 1.6, "no height")):
        with pytest.raises(AvatarError, match=words):
            scale_to_metres(height, height_m)


def test_four_strongest_joints_are_kept_and_their_weights_sum_to_one() -> None:
    weights = np.zeros((1, 24))
    weights[0, [3, 7, 9, 12, 20]] = 0.1, 0.4, 0.2, 0.05, 0.25
    index, weight = strongest_four(weights)
    assert index.tolist() == [[7, 20, 9, 3]]
    np.testing.assert_allclose(weight[0], np.array([0.4, 0.25, 0.2, 0.1]) / 0.95)


def without_weight() -> Float64Array:
    weights = human().weights.copy()
    weights[2] = 0.0
    return weights


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"weights": np.ones((2, 24))}, "must be .* x 24"),
        ({"weights": -human().weights}, "must not be negative"),
        ({"weights": without_weight()}, "1 of .* Gaussians have no skinning weight"),
        ({"joints": np.full((24, 3), np.nan)}, "Joints hold values that are not finite"),
        ({"joints": tpose_joints_m() * (1, -1, -1)}, "y must point up"),
        ({"cloud": human().cloud.select(np.zeros(0, np.int64)), "weights": np.zeros((0, 24))}, "no Gaussian"),
    ],
)
def test_humans_that_cannot_be_moved_are_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(AvatarError, match=words):
        assemble_avatar(dataclasses.replace(human(), **change), name="a", license_text="")


def test_tpose_is_made_by_turning_bones_unless_it_is_given() -> None:
    R = human().R_tpose_canonical.copy()
    R[JOINT["left_elbow"]] = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = assemble_avatar(dataclasses.replace(human(), R_tpose_canonical=R), name="a", license_text="")[0]
    forearm = turned.joints_tpose_m[JOINT["left_wrist"]] - turned.joints_tpose_m[JOINT["left_elbow"]]
    np.testing.assert_allclose(forearm, (0.0, 0.25, 0.0), atol=1e-6)
    given = dataclasses.replace(human(), R_tpose_canonical=R, joints_tpose=tpose_joints_m())
    joints_m = assemble_avatar(given, name="a", license_text="")[0].joints_tpose_m
    np.testing.assert_allclose(np.ptp(joints_m[:, 0]), np.ptp(tpose_joints_m()[:, 0]), atol=1e-6)
