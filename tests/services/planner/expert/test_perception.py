import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.robot import RobotConfig
from readygo.services.planner import ExpertConfig
from readygo.services.planner.expert.ground import SceneGround
from readygo.services.planner.expert.perception import HumanTracks
from tests.services.planner.worlds import rooms

POSE = (-1.0, 5.5, 0.0)
AWAY = (*POSE[:2], math.pi)
PATH = np.array([[0.2 + 0.05 * step, 5.5 + 0.01 * step] for step in range(200)])
BEHIND_WALL = np.array([[2.0, 8.5]])
BEFORE_WALL = (2.0, 5.0, math.pi / 2)


def _tracks(path=PATH, **options):
    occupancy = rooms()
    ground = SceneGround(occupancy, occupancy, None, RobotConfig(), EpisodeConfig(), ExpertConfig(**options))
    return HumanTracks(ground, ground.around((-1.0, 5.5), (2.0, 5.5)), [path], 40)


def _walk(step):
    return PATH[step : step + 1]


def test_papers_velocity_comes_from_consecutive_views():
    tracks = _tracks(mode="paper")
    first = tracks.observe(0, POSE, _walk(0))[0]
    assert (first.vx_mps, first.vy_mps) == (0.0, 0.0)
    for step in range(1, 8):
        human = tracks.observe(step, POSE, _walk(step))[0]
        assert (human.vx_mps, human.vy_mps) == pytest.approx((1.0, 0.2))
    assert human.ahead_m[-1] == pytest.approx((human.x_m + 2.0, human.y_m + 0.4))
    assert human.ahead_m.shape == (40, 2)


def test_human_out_of_view_is_unknown_at_first_and_remembered_for_a_while():
    tracks = _tracks(mode="paper")
    assert tracks.observe(0, AWAY, _walk(0)) == []
    for step in range(1, 6):
        tracks.observe(step, POSE, _walk(step))
    remembered = [tracks.observe(step, AWAY, np.array([[-9.0, -9.0]])) for step in range(6, 90)]
    assert [bool(humans) for humans in remembered] == [True] * 80 + [False] * 4
    assert not remembered[0][0].seen
    assert remembered[4][0].age_s == pytest.approx(0.25)
    assert (remembered[4][0].x_m, remembered[4][0].y_m) == pytest.approx(tuple(_walk(10)[0]))


def test_who_walks_out_of_view_is_remembered_for_four_seconds_by_default():
    tracks = _tracks()
    for step in range(6):
        tracks.observe(step, POSE, _walk(step))
    remembered = [tracks.observe(step, AWAY, np.array([[-9.0, -9.0]])) for step in range(6, 90)]
    assert [bool(humans) for humans in remembered] == [True] * 80 + [False] * 4


@pytest.mark.parametrize("mode", ["paper", "spacetime"])
def test_step_before_the_first_view_is_known_with_it(mode):
    tracks = _tracks(mode=mode)
    assert tracks.observe(0, AWAY, _walk(0)) == []
    human = tracks.observe(1, POSE, _walk(1))[0]
    assert (human.vx_mps, human.vy_mps) == pytest.approx((1.0, 0.2))
    assert human.ahead_m[9] == pytest.approx(tuple(PATH[11]), abs=0.02)


def test_who_stands_is_remembered_until_the_place_is_seen_empty_or_time_is_up():
    tracks = _tracks()
    for step in range(4):
        tracks.observe(step, POSE, _walk(0))
    for step in range(4, 140):
        remembered = tracks.observe(step, AWAY, np.array([[-9.0, -9.0]]))[0]
        assert (remembered.x_m, remembered.y_m) == pytest.approx(tuple(PATH[0]))
        assert remembered.ahead_m == pytest.approx(np.tile(PATH[0], (40, 1)))
    assert tracks.observe(140, POSE, np.array([[-9.0, -9.0]])) == []
    for step in range(141, 150):
        tracks.observe(step, POSE, _walk(0))
    assert [bool(tracks.observe(step, AWAY, _walk(0))) for step in range(150, 1352)] == [True] * 1200 + [False] * 2


def test_walls_hide_humans_by_default_in_space_time_and_not_in_the_papers_mode():
    assert _tracks(mode="paper").observe(0, BEFORE_WALL, BEHIND_WALL)
    assert not _tracks().observe(0, BEFORE_WALL, BEHIND_WALL)
    assert _tracks().observe(0, (0.0, 5.0, math.pi / 2), np.array([[0.0, 8.5]]))


def test_near_field_feels_behind_the_back_and_does_not_call_it_seen():
    behind = np.array([[POSE[0] - 1.5, POSE[1]]])
    assert _tracks().observe(0, POSE, behind) == []
    felt = _tracks(near_field_m=2.0).observe(0, POSE, behind)
    assert [human.seen for human in felt] == [False]
    assert _tracks(near_field_m=1.4).observe(0, POSE, behind) == []


def test_oracle_knows_through_walls_where_a_human_will_be():
    path = np.array([[2.0, 8.5]] * 10 + [[2.0 - 0.05 * k, 8.5] for k in range(20)])
    human = _tracks(path, oracle=True).observe(0, BEFORE_WALL, path[:1])[0]
    assert not human.seen
    assert np.allclose(human.ahead_m, path[np.minimum(np.arange(1, 41), 29)])
    assert len(human.find_walks()[0]) == 1


def test_somebody_on_the_robots_way_may_follow_it():
    """Walking from the goal towards the start: that route is among what is expected, with most of the chance."""
    path = np.array([[2.0 - 0.05 * k, 5.5] for k in range(60)])
    tracks = _tracks(path)
    for step in range(12):
        human = tracks.observe(step, POSE, path[step : step + 1])[0]
    walks_m, chances = human.find_walks()
    assert math.fsum(chances) == pytest.approx(1.0)
    assert chances[1] > chances[0]
    assert np.hypot(*(walks_m[1, 20] - path[11 + 21])) < 0.25


@pytest.mark.parametrize("mode", ["paper", "spacetime"])
def test_step_that_was_observed_already_changes_nothing(mode):
    once, twice = _tracks(mode=mode), _tracks(mode=mode)
    for step in range(20):
        (one,) = once.observe(step, POSE, _walk(step))
        twice.observe(step, POSE, _walk(step))
        (two,) = twice.observe(step, POSE, _walk(step))
        assert (one.vx_mps, one.vy_mps) == (two.vx_mps, two.vy_mps)
    assert one.vx_mps == pytest.approx(1.0)


@pytest.mark.parametrize("mode", ["paper", "spacetime"])
def test_what_is_expected_of_who_comes_and_goes_is_as_it_was(mode, golden_figures):
    """Someone on an arc past a robot that turns: seen, out of view, remembered and seen again."""
    k = np.arange(120)
    path = np.column_stack([1.6 - 1.9 * np.sin(0.028 * k), 5.6 + 0.5 * np.cos(0.05 * k)])
    tracks, rows = _tracks(path, mode=mode), []
    for step in range(120):
        pose = (-1.2, 5.3, 0.3 + 1.7 * math.sin(0.07 * step))
        for human in tracks.observe(step, pose, path[step : step + 1]):
            if step % 3 == 0:
                walks_m, chances = human.find_walks()
                rows += [
                    [
                        step,
                        human.x_m,
                        human.vx_mps,
                        human.vy_mps,
                        human.seen,
                        human.age_s,
                        chance,
                        *walk_m[19],
                        *walk_m[-1],
                    ]
                    for walk_m, chance in zip(walks_m, chances, strict=True)
                ]
    golden_figures(f"expert/perceived {mode}", np.array(rows))
