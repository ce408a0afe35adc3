import dataclasses
from typing import Any

import numpy as np
import pytest

from readygo.common.avatars import SMPL_PARENTS, Avatar


def test_skeleton_keeps_all_but_the_gaussians(avatar: Avatar) -> None:
    skeleton = avatar.skeleton()
    assert len(skeleton.cloud) == len(skeleton.lbs_index) == len(skeleton.lbs_weight) == 0
    assert skeleton.cloud.sh_degree == avatar.cloud.sh_degree
    assert (skeleton.name, skeleton.height_m) == (avatar.name, avatar.height_m)
    assert skeleton.joints_tpose_m is avatar.joints_tpose_m
    assert len(avatar.cloud) == 3000


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("lbs_index", np.zeros((3000, 3), np.uint8)),
        ("lbs_weight", np.zeros((2999, 4), np.float32)),
        ("lbs_weight", np.zeros((3000, 4))),
        ("joints_canonical_m", np.zeros((23, 3), np.float32)),
        ("joints_tpose_m", np.zeros((24, 3))),
        ("R_tpose_canonical", np.zeros((24, 3), np.float32)),
    ],
)
def test_arrays_of_another_shape_or_type_are_refused_by_name(avatar: Avatar, name: str, array: Any) -> None:
    with pytest.raises(ValueError, match=name):
        dataclasses.replace(avatar, **{name: array})


def test_parents_stand_before_their_children() -> None:
    assert (np.arange(24) > SMPL_PARENTS).all()
