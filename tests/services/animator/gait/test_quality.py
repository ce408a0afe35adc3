import dataclasses

import numpy as np
import pytest

from readygo.benchmarks.motion.paths import dash, floor, line, s_curve
from readygo.common.avatars import joint_positions
from readygo.services.animator import measure, skeleton_of
from readygo.services.animator.gait.quality import cadence_per_min, elbow_deg, joints_of, sole_points
from tests.services.animator.bodies import make_avatar

FLAT = floor()


@pytest.fixture(scope="module")
def good(animate):
    return animate(line(1.2), FLAT)


def changed(motion, **columns):
    return dataclasses.replace(motion, **{name: value.astype(np.float32) for name, value in columns.items()})


def test_joints_agree_with_the_avatars_kinematics(good, avatar):
    assert joints_of(good, avatar)[1] == pytest.approx(joint_positions(avatar, good), abs=1e-9)


def test_sliding_is_seen(good, avatar):
    slide = np.zeros_like(good.root_m)
    slide[:, 0] = 0.1 * np.arange(len(slide)) * 0.05
    bad = measure(changed(good, root_m=good.root_m + slide), avatar, FLAT, line(1.2))
    assert bad.skate_mean_cmps == pytest.approx(10.0, abs=1.0)


def test_sinking_and_floating_are_seen(good, avatar):
    shift = np.array([0.0, 0.0, 0.03])
    assert measure(changed(good, root_m=good.root_m - shift), avatar, FLAT, line(1.2)).penetration_max_mm > 25.0
    assert measure(changed(good, root_m=good.root_m + shift), avatar, FLAT, line(1.2)).hover_max_mm > 25.0


def test_a_foot_that_stands_in_the_air_hovers_and_a_flying_one_does_not(good, avatar, animate):
    lifted = changed(good, root_m=good.root_m + np.array([0.0, 0.0, 0.03]))
    assert measure(lifted, avatar, FLAT, line(1.2)).hover_max_mm > 25.0
    quality = measure(animate(dash(3.0), FLAT), avatar, FLAT, dash(3.0))
    assert quality.airborne_max_mm > 30.0
    assert quality.hover_max_mm < 1.0


def test_leaving_the_trajectory_is_seen(good, avatar):
    shift = np.array([0.0, 0.1, 0.0])
    assert measure(changed(good, root_m=good.root_m + shift), avatar, FLAT, line(1.2)).root_error_max_cm > 8.0


def test_a_jump_of_the_pose_is_seen(good, avatar):
    pose = good.pose_axis_angle.copy()
    pose[100:, 18] += 1.0
    bad = measure(changed(good, pose_axis_angle=pose), avatar, FLAT, line(1.2))
    assert bad.joint_speed_max_degps > 900.0


def test_an_elbow_bent_backwards_is_seen(good, avatar):
    pose = good.pose_axis_angle.copy()
    pose[:, 18] = 0.0, 0.6, 0.0
    assert measure(changed(good, pose_axis_angle=pose), avatar, FLAT, line(1.2)).elbow_min_deg < -20.0


def test_measures_of_a_shaken_walk_are_as_they_were(animate, golden_figures):
    body, ground, xy = make_avatar(scale=0.9), floor(lambda x, y: 0.02 * np.sin(3.0 * x)), s_curve(1.1)
    motion = animate(xy, ground, body=body, seed=3, style=1.0)
    shake = np.random.default_rng(6).normal(0.0, 0.004, motion.root_m.shape).astype(np.float32)
    shaken = dataclasses.replace(motion, root_m=motion.root_m + shake)
    golden_figures("gait/quality", [np.log1p(np.abs(dataclasses.astuple(measure(shaken, body, ground, xy))))])
    golden_figures("gait/quality cadence", [cadence_per_min(motion, body)], scale=0.1)
    G, P = joints_of(shaken, body)
    golden_figures("gait/soles", 5.0 * sole_points(G, P, skeleton_of(body)).reshape(len(G), -1))
    golden_figures("gait/elbows", 0.1 * elbow_deg(G, P, 0), 0.1 * elbow_deg(G, P, 1))
