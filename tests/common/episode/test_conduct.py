import math

import numpy as np
import pytest

from readygo.common.episode.conduct import NEAR_MISS_M, PERSONAL_SPACE_M, Contact, conduct_of, shortest_collision_time_s

CONTACT_M = 0.5


def measured(robot_x, human_x, v=None, sees=lambda pose, human: True):
    """A robot and a human on one line: places at all steps and at the end."""
    poses = np.zeros((len(robot_x), 3))
    poses[:, 0] = robot_x
    actions = np.zeros((len(robot_x) - 1, 2))
    actions[:, 0] = np.diff(robot_x) / 0.05 if v is None else v
    humans = np.zeros((len(robot_x), 1, 2))
    humans[:, 0, 0] = human_x
    return conduct_of(poses, actions, humans, dt_s=0.05, contact_m=CONTACT_M, sees=sees)


def test_time_in_personal_space_and_near_misses_are_counted():
    gaps = [1.0, 0.6, 0.4, 0.1, 0.4, 0.6, 0.15, 0.1, 0.7]
    conduct = measured(np.zeros(9), np.array(gaps) + CONTACT_M)
    assert conduct.intrusion_s == pytest.approx(5 * 0.05)
    assert conduct.near_misses == 2
    assert conduct.contact is None


def test_contact_is_no_near_miss_and_says_how_the_robot_met_the_human():
    conduct = measured(np.linspace(0, 1, 21), 1.45, sees=lambda pose, human: pose[0] >= 0.5)
    assert conduct.near_misses == 0
    assert conduct.contact == Contact(robot_mps=pytest.approx(1.0), in_view=True, seen_s=pytest.approx(0.5))
    assert conduct.contact.robot_moved
    assert not conduct.contact.at_fault, "half a second is too short to react"
    assert measured(np.linspace(0, 1, 41), 1.45).contact.at_fault


def test_robot_that_stands_is_not_at_fault():
    conduct = measured(np.zeros(40), np.linspace(2.0, 0.4, 40))
    assert not conduct.contact.robot_moved
    assert not conduct.contact.at_fault


def test_smooth_driving_has_no_jerk_and_jerky_driving_has():
    assert measured(np.arange(20) * 0.05, 9.0).jerk_mps3 == pytest.approx(0.0, abs=1e-9)
    back_and_forth = measured(np.zeros(21), 9.0, v=np.tile([0.0, 0.05], 10))
    assert back_and_forth.jerk_mps3 == pytest.approx(0.1 / 0.05**2)


def test_run_without_humans_or_steps_is_measured():
    nobody = conduct_of(
        np.zeros((3, 3)), np.zeros((2, 2)), np.zeros((3, 0, 2)), dt_s=0.05, contact_m=0.5, sees=lambda *_: True
    )
    assert (nobody.intrusion_s, nobody.near_misses, nobody.contact) == (0.0, 0, None)
    assert measured(np.zeros(1), 2.0).turn_acceleration_radps2 == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_conduct_is_that_of_a_loop_over_steps_and_people(seed):
    """Three people come and go about a robot that drives a curve; times, gaps and changes are counted one by one."""
    rng, dt_s, contact_m = np.random.default_rng(seed), 1 / 30, 0.57
    poses, humans = rng.normal(0.0, 0.02, (91, 3)).cumsum(axis=0), rng.normal(0.0, 0.12, (91, 3, 2)).cumsum(axis=0)
    humans += rng.uniform(0.8, 1.3) * np.array([[1.0, 0.3], [-0.7, 0.9], [-0.2, -1.0]])
    actions = rng.normal(0.4, 0.3, (90, 2))
    sees = lambda pose, human: (pose[0] + 2 * pose[1] + 3 * pose[2] + human[0] - human[1]) > 0  # noqa: E731

    inside, misses = 0, 0
    spell_m = [None] * 3
    for k in range(91):
        gaps_m = [math.dist(poses[k, :2], humans[k, n]) - contact_m for n in range(3)]
        if k > 0 and min(gaps_m) < PERSONAL_SPACE_M:
            inside += 1
        for n, gap_m in enumerate(gaps_m):
            if gap_m < NEAR_MISS_M:
                spell_m[n] = min(gap_m, spell_m[n] if spell_m[n] is not None else gap_m)
            if spell_m[n] is not None and (gap_m >= NEAR_MISS_M or k == 90):
                misses += spell_m[n] >= 0
                spell_m[n] = None
    v, w = actions[:, 0], actions[:, 1]
    jerks = [((v[k + 2] - v[k + 1]) / dt_s - (v[k + 1] - v[k]) / dt_s) / dt_s for k in range(88)]
    turns = [abs(w[k + 1] - w[k]) / dt_s for k in range(89)]

    conduct = conduct_of(poses, actions, humans, dt_s=dt_s, contact_m=contact_m, sees=sees)
    assert conduct.intrusion_s == pytest.approx(inside * dt_s)
    assert conduct.near_misses == misses
    assert conduct.jerk_mps3 == pytest.approx(math.sqrt(sum(jerk**2 for jerk in jerks) / 88))
    assert conduct.turn_acceleration_radps2 == pytest.approx(sum(turns) / 89)
    assert (conduct.contact is not None) == (min(gaps_m) < 0)
    if conduct.contact is not None:
        touched = humans[:, int(np.argmin(gaps_m))]
        seen = [bool(sees(pose, human)) for pose, human in zip(poses, touched, strict=True)]
        assert conduct.contact == Contact(
            robot_mps=v[-1], in_view=seen[-1], seen_s=pytest.approx(sum(seen[:-1]) * dt_s)
        )


def test_start_beside_somebody_is_no_time_in_their_space_and_limits_are_sharp():
    assert measured(np.zeros(3), CONTACT_M + np.array([0.25, 0.75, 0.75])).intrusion_s == 0.0
    # Sums of powers of two are exact.
    assert measured(np.zeros(3), [2.0, CONTACT_M + PERSONAL_SPACE_M, 2.0]).intrusion_s == 0.0
    assert measured(np.zeros(3), [2.0, CONTACT_M + PERSONAL_SPACE_M - 2**-20, 2.0]).intrusion_s == 0.05
    touch = measured(np.zeros(3), [2.0, 0.6, CONTACT_M])
    assert (touch.contact, touch.near_misses) == (None, 1)


@pytest.mark.parametrize(
    ("robot_mps", "seen_s", "moved", "at_fault"),
    [(0.1, 1.0, True, True), (0.1, 0.95, True, False), (0.09, 2.0, False, False), (-0.3, 2.0, True, True)],
)
def test_fault_needs_a_robot_that_moves_and_a_second_of_sight(robot_mps, seen_s, moved, at_fault):
    contact = Contact(robot_mps=robot_mps, in_view=True, seen_s=seen_s)
    assert (contact.robot_moved, contact.at_fault) == (moved, at_fault)


def test_time_too_close_counts_the_distance_of_the_centres():
    conduct = measured(np.zeros(6), np.array([2.0, 1.2, 1.0, 0.99, 0.8, 1.3]))
    assert conduct.too_close_s == pytest.approx(2 * 0.05)


def test_shortest_time_to_collision_is_that_of_discs_that_keep_their_velocities():
    # 1 m/s towards somebody who stands 3 m ahead: nearest after the last step, 1 m before, contact at 0.5 m.
    assert measured(np.linspace(0.0, 2.0, 41), 3.0).collision_time_min_s == pytest.approx(0.5)
    assert measured(np.linspace(0.0, 2.6, 53), 3.0).collision_time_min_s == 0.0, "in contact"
    assert measured(np.linspace(0.0, -2.0, 41), 3.0).collision_time_min_s is None, "apart"
    robot = np.stack([np.linspace(0.0, 2.0, 41), np.zeros(41)], axis=1)
    beside = np.tile([[[3.0, 0.51]]], (41, 1, 1))
    assert shortest_collision_time_s(robot, beside, dt_s=0.05, contact_m=0.5) is None, "passes by"
    at_an_angle = np.tile([[[3.0, 0.3]]], (41, 1, 1))
    assert shortest_collision_time_s(robot, at_an_angle, dt_s=0.05, contact_m=0.5) == pytest.approx(1.0 - 0.4)
    both = np.concatenate([beside, at_an_angle], axis=1)
    assert shortest_collision_time_s(robot, both, dt_s=0.05, contact_m=0.5) == pytest.approx(0.6)
    assert shortest_collision_time_s(robot, np.zeros((41, 0, 2)), dt_s=0.05, contact_m=0.5) is None
    leaving = robot[:, None] + np.linspace(0.1, 3.0, 41)[:, None, None] * (0.0, 1.0)
    assert shortest_collision_time_s(robot, leaving, dt_s=0.05, contact_m=0.5) == 0.0, "in contact, and moving apart"
