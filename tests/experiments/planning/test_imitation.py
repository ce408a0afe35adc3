import json
import math

import numpy as np
import pytest

from experiments.planning.imitation import RAYS, Eyes, fitted, mirrored, samples_of, study, successful_runs, text
from readygo.benchmarks.planning.maps import MapSource
from readygo.benchmarks.planning.runs import Course, PlanningJob

torch = pytest.importorskip("torch", reason="needs the extra train")


@pytest.fixture(scope="module")
def course():
    return Course(
        PlanningJob(source=MapSource(name="embedded", path="embedded"), modes=("paper",), tasks=("dynamic",), seed=3)
    )


@pytest.fixture
def eyes(course):
    return Eyes(course.maps.robot, course.robot.camera, course.episode.human_radius_m)


def test_samples_tell_what_is_ahead_and_what_the_expert_does(course, eyes):
    runs, _ = successful_runs(course, "paper", 1)
    samples = samples_of(eyes, runs)
    scenario, _, run = runs[0]
    assert len(samples.actions) == math.ceil(len(run.actions) / 4)
    np.testing.assert_array_equal(samples.actions[1], [*run.actions[4], *run.actions[14]])
    np.testing.assert_array_equal(samples.plain[1, 3:5], run.actions[3])
    x, y, _ = scenario.start_xyyaw
    away_m = math.hypot(*(scenario.goal_xy_m - (x, y)))
    np.testing.assert_allclose(samples.plain[0, :3], [1, 0, away_m / 10], atol=1e-9)
    rays = samples.plain[:, 5:]
    assert rays.shape[1] == RAYS
    assert (rays > 0).all()
    assert rays.max() <= 1


def test_humans_are_told_of_in_the_robots_frame_only_when_they_are_in_view(course, eyes):
    x, y, yaw = successful_runs(course, "paper", 1)[0][0][0].start_xyyaw.tolist()
    ahead, left = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
    seen = eyes.people((x, y, yaw), np.array([(x, y) + 0.6 * ahead]), np.array([(x, y) + 0.6 * ahead - 0.2 * left]))
    np.testing.assert_allclose(seen, [1, 0.6, 0, 0, 1, 0, 0, 0, 0, 0], atol=1e-9)
    behind = np.array([(x, y) - 0.6 * ahead])
    assert not any(eyes.people((x, y, yaw), behind, behind))


def test_mirroring_twice_changes_nothing_and_swaps_the_rays():
    inputs = np.random.default_rng(0).normal(size=(3, 5 + RAYS + 10))
    once = mirrored(inputs)
    np.testing.assert_array_equal(mirrored(once), inputs)
    np.testing.assert_array_equal(once[:, 5], inputs[:, 4 + RAYS])
    np.testing.assert_array_equal(once[:, [0, 2, 3]], inputs[:, [0, 2, 3]])
    np.testing.assert_array_equal(once[:, [6 + RAYS, 7 + RAYS]], inputs[:, [6 + RAYS, 7 + RAYS]] * [1, -1])


def test_what_follows_from_the_inputs_is_learned_and_noise_is_not():
    rng = np.random.default_rng(1)
    inputs = rng.normal(size=(1200, 5 + RAYS))
    noise = rng.normal(size=(1200, 2))
    targets = np.column_stack([inputs[:, 0], inputs[:, 1], noise])
    part = np.repeat(np.int8([0, 1, 2]), [900, 100, 200])
    error = ((fitted(inputs, targets, part, seed=0) - targets)[part == 2] ** 2).mean(axis=0)
    assert (error[:2] < 0.3).all()
    assert (error[2:] > 0.7).all()


def test_study_reports_all_features_of_an_expert(course):
    result = study(course, "paper", 8)
    json.dumps(result)
    assert result["repeat"]["all"]["change_v"] == result["repeat"]["all"]["change_w"] == 1.0
    lines = text([result]).splitlines()
    assert [line[12:23].strip() for line in lines[2:]] == ["repeat", "no people", "people"]
