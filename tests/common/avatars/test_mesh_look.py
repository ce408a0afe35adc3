import numpy as np
import pytest

from readygo.common.avatars import load_avatars
from readygo.common.avatars.mesh_look import BODY_PARTS, LIGHT_FROM, fixed_light, mesh_like
from readygo.common.gaussians.irradiance import irradiance


def test_every_part_has_one_colour_and_the_body_stays():
    avatar = load_avatars()["gil"]
    plain = mesh_like(avatar)
    assert len(np.unique(plain.cloud.sh.reshape(len(plain.cloud), -1), axis=0)) <= len(BODY_PARTS)
    assert plain.cloud.sh.shape == (len(plain.cloud), 1, 3)
    assert np.array_equal(plain.cloud.means_m, avatar.cloud.means_m)
    assert np.array_equal(plain.lbs_weight, avatar.lbs_weight)


def test_all_joints_are_of_one_part():
    assert sorted(joint for joints in BODY_PARTS.values() for joint in joints) == list(range(24))


def test_light_comes_from_one_side_and_is_the_same_for_all_colours():
    towards, away = irradiance(fixed_light(), np.array([LIGHT_FROM, -np.array(LIGHT_FROM)]))
    assert towards == pytest.approx(towards[0])
    assert towards[0] > 2 * away[0] > 0


def test_mesh_and_its_light_are_as_they_were(golden_figures):
    golden_figures("avatars/mesh colours", mesh_like(load_avatars()["gil"]).cloud.sh[::7, 0])
    golden_figures("avatars/mesh light", fixed_light().reshape(3, 16))
