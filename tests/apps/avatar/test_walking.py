"""The film of a walk: people stand on the floor's lines."""

import itertools

import numpy as np
import pytest

from readygo.apps.avatar.walking import (
    AMPLITUDE_M,
    FPS,
    FRAMING,
    LENGTH_M,
    MOTIONS,
    RUN_MPS,
    SPEED_MPS,
    phase_rows,
    s_curve_walk,
    sheet_motion,
    walk_frames,
)
from readygo.common.avatars import Avatar, joint_positions, load_avatars
from readygo.common.errors import AvatarError
from readygo.common.frames import matrix_from_axis_angle


@pytest.fixture(scope="module")
def person() -> Avatar:
    return next(iter(load_avatars().values()))


def test_walk_follows_the_s_curve_to_its_end(person: Avatar) -> None:
    root = s_curve_walk(person).root_m
    sway = AMPLITUDE_M * np.sin(2 * np.pi * root[:, 0] / LENGTH_M)
    assert np.abs(root[:, 1] - sway).max() < 0.05
    assert root[-1, 0] == pytest.approx(LENGTH_M, abs=0.1)


def test_pictures_show_the_human_before_wall_and_floor(person: Avatar) -> None:
    first, *_, last = itertools.islice(walk_frames(person), 0, 12)
    assert first.shape == (FRAMING.height_px, FRAMING.width_px, 3)
    wall = first[5, 5].astype(int)
    middle = first[:, FRAMING.width_px // 4 : 3 * FRAMING.width_px // 4].astype(int)
    person_rows = np.flatnonzero((np.abs(middle - wall).max(axis=2) > 100).any(axis=1))
    assert 0.3 * FRAMING.height_px < np.ptp(person_rows) < 0.95 * FRAMING.height_px
    lines = first[-5].astype(int).mean(axis=1)
    assert lines.min() < lines.max() - 30
    assert (first != last).any()


def test_phases_are_quarters_of_a_stride() -> None:
    t = np.arange(120)
    joints = np.zeros((120, 24, 3))
    joints[:, 0, 0] = 0.06 * t
    joints[:, 7, 0] = 0.06 * t + 0.3 * np.cos(2 * np.pi * (t - 8) / 20)
    first, *others = phase_rows(joints)
    assert first % 20 == 8
    assert [row - first for row in others] == [5, 10, 15]
    with pytest.raises(AvatarError, match="no whole stride"):
        phase_rows(joints[:20])


def test_sheet_shows_a_walk_a_turn_and_a_run(person: Avatar) -> None:
    walked, turned, ran = (sheet_motion(person, name) for name in MOTIONS)
    for (motion, rows), speed_mps in ((walked, SPEED_MPS), (ran, RUN_MPS)):
        seconds = (rows[-1] - rows[0]) / FPS
        assert (motion.root_m[rows[-1], 0] - motion.root_m[rows[0], 0]) / seconds == pytest.approx(speed_mps, rel=0.05)
    # Both feet are off the floor in a run alone.
    flying = [
        (joint_positions(person, motion)[rows[0] : rows[-1], [7, 8], 2].min(axis=1) > 1.4 * person.joints_tpose_m[7, 1])
        for motion, rows in (walked, ran)
    ]
    assert not flying[0].any()
    assert flying[1].any()
    heading = [np.asarray(matrix_from_axis_angle(turned[0].pose_axis_angle[row, 0])) @ (0.0, 0.0, 1.0) for row in
               (turned[1][0], turned[1][-1])]  # fmt: skip
    assert float(heading[0] @ heading[1]) < -0.8
