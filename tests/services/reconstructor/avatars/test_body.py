"""Bodies come to the person's size, and silhouettes tell swapped sides."""

from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.services.reconstructor.avatars.body import overlap_of, scale_body, sized_body, swap_sides
from readygo.services.reconstructor.avatars.footage import read_footage
from readygo.services.reconstructor.avatars.views import read_person


@pytest.mark.parametrize("factor", [0.85, 1.2])
def test_a_body_is_brought_to_the_persons_size(plain_film: Path, coarse_body: Avatar, factor: float) -> None:
    footage = read_footage(plain_film)
    person = read_person(footage, 96)
    given = scale_body(coarse_body, factor)
    body, overlap = sized_body(given, person, footage.pose_axis_angle, footage.root_m)
    assert body.height_m == pytest.approx(coarse_body.height_m, rel=0.1)
    assert overlap > max(0.7, overlap_of(given, person, footage.pose_axis_angle, footage.root_m))


def test_swapped_sides_fit_worse(plain_film: Path, coarse_body: Avatar) -> None:
    footage = read_footage(plain_film)
    person = read_person(footage, 96)
    swapped = swap_sides(footage.pose_axis_angle)
    np.testing.assert_array_equal(swap_sides(swapped), footage.pose_axis_angle)
    overlaps = [overlap_of(coarse_body, person, pose, footage.root_m) for pose in (footage.pose_axis_angle, swapped)]
    assert overlaps[0] > overlaps[1] + 0.1
