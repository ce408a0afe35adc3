import json

import numpy as np
import pytest

from readygo.benchmarks.motion import gates as motion
from readygo.benchmarks.motion.gates import BenchMotionOptions, MotionGate, bench_motion, feature_gates, mocap_gates
from readygo.common.errors import ConfigError
from tests.services.animator.bodies import make_avatar


@pytest.fixture
def one_gate(monkeypatch):
    """Replaces the measurements, which take half a minute, by one number as NumPy gives it."""
    for name in ("path_gates", "steady_gates", "run_gates", "feature_gates"):
        monkeypatch.setattr(motion, name, lambda *_: iter(()))
    monkeypatch.setattr(motion, "cost_ms", lambda _: np.float64(61.0))


def test_gates_are_inclusive():
    assert MotionGate("a", 1.0, 1.0, 1.0).held
    assert not MotionGate("a", 1.1, 0.0, 1.0).held
    assert not MotionGate("a", float("nan"), 0.0, 1.0).held


def test_json_says_which_gates_are_held_and_that_mocap_is_absent(one_gate, tmp_path, capsys):
    bench_motion(BenchMotionOptions(avatar="bruno", mocap=tmp_path / "none", json=True))
    printed = json.loads(capsys.readouterr().out)
    row = {"name": "ms_per_10s", "value": 61.0, "low": 0.0, "high": 60.0, "held": False}
    assert printed == {"avatar": "bruno", "mocap": "absent", "gates": [row]}


def test_table_marks_what_is_beyond_its_limits(one_gate, tmp_path, capsys):
    bench_motion(BenchMotionOptions(mocap=tmp_path / "none"))
    text = capsys.readouterr().out
    assert "BEYOND" in text
    assert "mocap absent" in text
    assert "0 of 1 gates held by 'amara'" in text


def test_unknown_avatar_is_a_users_mistake():
    with pytest.raises(ConfigError, match="'nobody' is not embedded; there are amara"):
        bench_motion(BenchMotionOptions(avatar="nobody"))


def test_curves_of_one_walk_give_the_other_one(mocap):
    gates = list(mocap_gates(make_avatar(), mocap))
    assert len(gates) == 12
    assert [gate for gate in gates if not gate.held] == []


def test_features_give_joints_and_paths_back():
    assert [gate for gate in feature_gates(make_avatar()) if not gate.held] == []
