"""Poses, masks and cameras of other frames are refused, and masks without feet."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar
from readygo.common.avatars import Avatar
from readygo.common.errors import AvatarError
from readygo.services.reconstructor.avatars.agreement import check_agreement
from readygo.services.reconstructor.avatars.body import overlap_of, some_frames, swap_sides
from readygo.services.reconstructor.avatars.footage import Footage, read_footage
from readygo.services.reconstructor.avatars.views import FilmedPerson, read_person


@pytest.fixture(scope="module")
def footage(plain_film: Path) -> Footage:
    return read_footage(plain_film)


@pytest.fixture(scope="module")
def person(footage: Footage) -> FilmedPerson:
    return read_person(footage, 512)


def check(body: Avatar, person: FilmedPerson, footage: Footage, pose: np.ndarray | None = None) -> list[str]:
    pose = footage.pose_axis_angle if pose is None else pose
    overlap = overlap_of(body, person, pose, footage.root_m)
    return check_agreement(body, overlap, person, pose, footage.root_m)


def without_feet(person: FilmedPerson, share: float, frames: list[int]) -> FilmedPerson:
    """The lowest share of some masks is black."""
    masks = list(person.mask)
    for frame in frames:
        masks[frame] = masks[frame].copy()
        rows = np.flatnonzero(masks[frame].any(axis=1))
        masks[frame][rows[-1] - round(share * np.ptp(rows)) :] = False
    return replace(person, mask=tuple(masks))


def test_masks_with_feet_give_no_hint(coarse_body: Avatar, person: FilmedPerson, footage: Footage) -> None:
    assert check(coarse_body, person, footage) == []


@pytest.mark.parametrize("share", [0.12, 0.2])
def test_masks_without_feet_are_refused(
    share: float, coarse_body: Avatar, person: FilmedPerson, footage: Footage
) -> None:
    with pytest.raises(AvatarError, match="In 6 of 6 frames that were looked at the masks end above the feet"):
        check(coarse_body, without_feet(person, share, list(range(12))), footage)


def test_some_masks_without_feet_give_a_hint(coarse_body: Avatar, person: FilmedPerson, footage: Footage) -> None:
    some = some_frames(person)[:2]
    (note,) = check(coarse_body, without_feet(person, 0.15, some), footage)
    assert note == "the masks end above the feet in 2 of 6 frames that were looked at."
    assert check(coarse_body, without_feet(person, 0.15, some[:1]), footage) == []


@pytest.mark.parametrize(("shift", "said"), [(3, "3 frames later"), (-2, "2 frames earlier")])
def test_masks_of_other_frames_are_named_by_the_shift(
    shift: int, said: str, coarse_body: Avatar, footage: Footage
) -> None:
    others = np.roll(np.arange(len(footage)), shift)
    person = read_person(replace(footage, masks=tuple(footage.masks[number] for number in others)), 512)
    with pytest.raises(AvatarError, match=f"The masks of {said} fit the poses better"):
        check(coarse_body, person, footage)


def test_swapped_sides_and_another_place_are_refused(
    coarse_body: Avatar, person: FilmedPerson, footage: Footage
) -> None:
    with pytest.raises(AvatarError, match="sides of the joints are swapped"):
        check(coarse_body, person, footage, swap_sides(footage.pose_axis_angle))
    with pytest.raises(AvatarError, match="look at the cameras"):
        check(coarse_body, person, replace(footage, root_m=footage.root_m + np.array([1.0, 0.0, 0.0])))


def test_poses_of_other_frames_of_a_camera_that_follows_are_named_by_the_shift(
    coarse_body: Avatar, tmp_path: Path
) -> None:
    config = AvatarCaptureConfig(frames=16, width_px=96, height_px=96, layout="plain")
    capture_avatar(coarse_body, tmp_path / "walk", config, lambda _: None)
    walk = read_footage(tmp_path / "walk")
    person = read_person(walk, 512)
    assert check(coarse_body, person, walk) == []
    shifted = replace(
        walk, root_m=np.roll(walk.root_m, 3, axis=0), pose_axis_angle=np.roll(walk.pose_axis_angle, 3, axis=0)
    )
    with pytest.raises(AvatarError, match=r"The poses of about [34] frames later fit the masks better"):
        check(coarse_body, person, shifted)
