import json
from pathlib import Path

import numpy as np
import pytest

from readygo.benchmarks.motion import gait_curves as source
from readygo.benchmarks.motion.cmu import RATE_HZ, read_clip
from readygo.benchmarks.motion.gates import feature_gates, mocap_gates
from readygo.benchmarks.motion.mocap import leg_curves_deg
from readygo.services.animator.gait import curves as gait_curves
from readygo.services.animator.gait.curves import curve_at, default_curves, stride_rate, weights_of


@pytest.fixture(scope="module")
def mocap(shared_data):
    return shared_data / "motion" / "cmu"


def test_shares_of_the_clips_sum_to_one_and_choose_the_speed():
    curves = default_curves()
    for speed, run in ((0.0, 0.0), (1.3, 0.0), (2.0, 0.4), (3.0, 1.0)):
        assert weights_of(curves, speed, run).sum() == pytest.approx(1.0)
    assert weights_of(curves, curves.speed[0], 0.0) == pytest.approx([1.0, 0.0, 0.0])
    assert weights_of(curves, 0.5 * (curves.speed[0] + curves.speed[1]), 0.0) == pytest.approx([0.5, 0.5, 0.0])
    assert weights_of(curves, 3.0, 1.0) == pytest.approx([0.0, 0.0, 1.0])


def test_curves_pass_through_their_samples_without_corners():
    table = default_curves().swing_pitch
    weights = np.array([1.0, 0.0, 0.0])
    ends = np.arange(gait_curves.SAMPLES) / (gait_curves.SAMPLES - 1)
    assert [curve_at(table, weights, x) for x in ends] == pytest.approx(table[0])
    slopes = [
        [(curve_at(table, weights, x + d) - curve_at(table, weights, x + d - 1e-5)) / 1e-5 for d in (0.0, 1e-5)]
        for x in ends[1:-1]
    ]
    assert np.abs(np.diff(slopes, axis=1)).max() < 0.01


def test_swings_begin_and_end_as_stances_end_and_begin():
    curves = default_curves()
    assert curves.swing_pitch[:, 0] == pytest.approx(curves.stance_pitch[:, -1])
    assert curves.swing_pitch[:, -1] == pytest.approx(curves.stance_pitch[:, 0])
    assert curves.swing_way[:, 0] == pytest.approx(0.0)
    assert curves.swing_way[:, -1] == pytest.approx(1.0)


def test_runners_step_more_often_than_the_walk_that_they_leave():
    assert 120.0 * stride_rate(2.9, 1.0, 1.0) == pytest.approx(157.0, rel=0.03)
    assert stride_rate(3.5, 1.0, 1.0) > stride_rate(2.5, 1.0, 1.0)


def test_file_of_the_curves_is_what_the_script_derives(mocap):
    stored = json.loads(Path(gait_curves.__file__).with_name("curves.json").read_text())["clips"]
    assert list(stored) == [*source.WALKS, *source.RUNS]
    for name, clip in stored.items():
        derived = source.derive(mocap, name)
        assert derived.keys() == clip.keys()
        for key, value in derived.items():
            assert np.abs(np.asarray(value, dtype=float) - np.asarray(clip[key], dtype=float)).max() <= 2e-4, key


def test_mocap_is_read_as_its_statistics_say(mocap):
    joints, _ = read_clip(mocap, "02_01")
    hip, knee = leg_curves_deg(source.load_clip(mocap, "02_01").joints_m, RATE_HZ, np.eye(3)[2], np.eye(3)[1])
    assert np.ptp(joints[:, 0, 2]) / (len(joints) / RATE_HZ) == pytest.approx(1.18, abs=0.03)
    assert (hip.min(), hip.max()) == pytest.approx((-17.6, 31.3), abs=2.0)
    assert (knee.min(), knee.max()) == pytest.approx((9.7, 72.8), abs=2.0)


def test_curves_of_one_walk_give_the_other_one(mocap, avatar):
    gates = list(mocap_gates(avatar, mocap))
    assert len(gates) == 12
    assert [gate for gate in gates if not gate.held] == []


def test_features_give_joints_and_paths_back(avatar):
    assert [gate for gate in feature_gates(avatar) if not gate.held] == []
