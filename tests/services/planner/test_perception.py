import math

import numpy as np
import pytest

from services.planner import ExpertConfig
from services.planner.perception import HumanTracks, in_view
from tests.services.planner.conftest import rooms

HALF_FOV = math.radians(50)
POSE = (0.0, 4.0, 0.0)


@pytest.mark.parametrize(
    ("bearing_deg", "seen"), [(0, True), (49, True), (-49, True), (53, True), (60, False), (-60, False), (180, False)]
)
def test_a_human_is_seen_if_any_part_of_its_disc_is_in_view(bearing_deg, seen):
    angle = math.radians(bearing_deg)
    assert in_view((1.0, 1.0, 0.0), 1 + 3 * math.cos(angle), 1 + 3 * math.sin(angle), HALF_FOV, 10.0, 0.25) is seen


def test_view_turns_with_the_robot_and_ends_at_its_range():
    assert in_view((0.0, 0.0, 7 * math.pi), -3.0, 0.0, HALF_FOV, 10.0, 0.25)
    assert not in_view((0.0, 0.0, 0.0), 10.1, 0.0, HALF_FOV, 10.0, 0.25)


def _tracks(**options):
    return HumanTracks(rooms(), 100.0, 0.25, ExpertConfig(**options))


def _walk(step):
    return np.array([[2.0 + 0.05 * step, 4.0 + 0.02 * step]])


def test_velocity_comes_from_consecutive_views():
    tracks = _tracks()
    first = tracks.observe(0, POSE, _walk(0))[0]
    assert (first.vx_mps, first.vy_mps) == (0.0, 0.0)
    for step in range(1, 8):
        human = tracks.observe(step, POSE, _walk(step))[0]
        assert (human.vx_mps, human.vy_mps) == pytest.approx((1.0, 0.4))
    assert human.ahead(40)[-1] == pytest.approx((human.x_m + 2.0, human.y_m + 0.8))


def test_human_out_of_view_is_unknown_at_first_and_remembered_for_a_while():
    away = (*POSE[:2], math.pi)
    tracks = _tracks(memory_s=0.5)
    assert tracks.observe(0, away, _walk(0)) == []
    for step in range(1, 6):
        tracks.observe(step, POSE, _walk(step))
    remembered = [tracks.observe(step, away, np.array([[-9.0, -9.0]])) for step in range(6, 20)]
    assert [bool(humans) for humans in remembered] == [True] * 10 + [False] * 4
    assert not remembered[0][0].seen
    assert (remembered[4][0].x_m, remembered[4][0].y_m) == pytest.approx(tuple(_walk(10)[0]))


def test_without_memory_nothing_stays():
    tracks = _tracks(memory_s=0.0)
    tracks.observe(0, POSE, _walk(0))
    assert tracks.observe(1, (*POSE[:2], math.pi), _walk(1)) == []


def test_walls_hide_humans_only_if_line_of_sight_is_asked_for():
    behind_wall = np.array([[2.0, 8.5]])
    pose = (2.0, 5.0, math.pi / 2)
    assert _tracks(mode="paper").observe(0, pose, behind_wall)
    assert not _tracks(mode="paper", line_of_sight=True).observe(0, pose, behind_wall)
    assert _tracks(line_of_sight=True).observe(0, (0.0, 5.0, math.pi / 2), np.array([[0.0, 8.5]]))
