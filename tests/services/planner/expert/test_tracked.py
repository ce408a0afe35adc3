import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.perception.people import NOBODY, People
from readygo.common.robot import RobotConfig
from readygo.services.planner import ExpertConfig
from readygo.services.planner.expert.ground import SceneGround
from readygo.services.planner.expert.tracked import TrackedHumans
from tests.services.planner.worlds import rooms

POSE = (-1.0, 5.5, 0.0)
NONE = np.empty((0, 2))


def tracked() -> TrackedHumans:
    occupancy = rooms()
    ground = SceneGround(occupancy, occupancy, None, RobotConfig(), EpisodeConfig(), ExpertConfig())
    return TrackedHumans(ground, ground.around((-1.0, 5.5), (2.0, 5.5)), 40)


def one(x_m: float, y_m: float, vx: float, vy: float, sd: float = 0.05) -> People:
    """Somebody at a place of the world, in the frame of a robot at `POSE`."""
    return People(
        presence=np.array([0.95]),
        xy_m=np.array([[x_m - POSE[0], y_m - POSE[1]]]),
        place_cov=sd**2 * np.eye(2)[None],
        v_mps=np.array([[vx, vy]]),
        velocity_cov=0.1**2 * np.eye(2)[None],
    )


def walk(humans: TrackedHumans, steps: int = 20, vy: float = 0.2) -> None:
    for step in range(0, steps, 2):
        humans.look(step, POSE, one(0.5 + 0.05 * step, 5.5 + 0.05 * vy * step, 1.0, vy))
        humans.observe(step, POSE, NONE)
        humans.observe(step + 1, POSE, NONE)


def test_walking_human_is_known_with_its_way_ahead() -> None:
    humans = tracked()
    walk(humans)
    (human,) = humans.observe(19, POSE, NONE)
    assert (human.x_m, human.y_m) == pytest.approx((1.45, 5.69), abs=0.03)
    assert (human.vx_mps, human.vy_mps) == pytest.approx((1.0, 0.2), abs=0.05)
    assert human.ahead_m.shape == (40, 2)
    assert human.ahead_m[9] == pytest.approx((1.95, 5.79), abs=0.08)
    assert not human.seen
    assert human.age_s == pytest.approx(0.05)
    assert 0.0 < human.deviation_m < 0.1
    assert 0.0 < human.deviation_mps < 0.5


def test_asked_again_it_says_the_same_and_a_look_changes_that() -> None:
    humans = tracked()
    humans.look(0, POSE, one(1.0, 5.5, 0.0, 0.0))
    first = humans.observe(0, POSE, NONE)
    assert humans.observe(0, POSE, NONE) is first
    assert first[0].seen
    humans.look(1, POSE, one(1.1, 5.5, 0.0, 0.0))
    assert humans.observe(1, POSE, NONE)[0].x_m > first[0].x_m


def test_who_moves_less_than_can_be_told_stands() -> None:
    humans = tracked()
    walk(humans, vy=0.0)
    humans = tracked()
    for step in range(0, 20, 2):
        humans.look(step, POSE, one(1.0 + 0.002 * step, 5.5, 0.04, 0.0))
    (human,) = humans.observe(19, POSE, NONE)
    assert (human.vx_mps, human.vy_mps) == (0.0, 0.0)
    assert human.ahead_m[-1] == pytest.approx((human.x_m, human.y_m))


def test_who_is_not_seen_where_the_camera_looks_is_forgotten() -> None:
    humans = tracked()
    walk(humans)
    for step in range(20, 40, 2):
        humans.look(step, POSE, NOBODY)
    assert humans.observe(40, POSE, NONE) == []


def test_behind_the_back_humans_are_remembered_and_walk_on() -> None:
    humans, away = tracked(), (*POSE[:2], np.pi)
    walk(humans)
    for step in range(20, 40, 2):
        humans.look(step, away, NOBODY)
    (human,) = humans.observe(40, away, NONE)
    assert human.x_m == pytest.approx(0.5 + 0.05 * 40, abs=0.15)
    assert not human.seen
