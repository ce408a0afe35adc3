from pathlib import Path

import pytest

from readygo.apps.learn.choice import PolicyMeasurement
from readygo.apps.learn.curve import CurvePoint, load_curve, measurements_of, save_curve
from readygo.common.errors import RunError


def test_points_come_back_as_they_were(tmp_path: Path) -> None:
    measurement = PolicyMeasurement(fraction=0.2, policy="ab", episodes=8, static=0.5, dynamic=0.25)
    points = [
        CurvePoint(minutes=0.5, recorded=100, learned=0, policies=0),
        CurvePoint(minutes=1.0, recorded=200, learned=900, policies=2, loss=0.1, driven=0.4, measurement=measurement),
    ]
    save_curve(tmp_path / "curve.json", points)
    assert load_curve(tmp_path / "curve.json") == points
    assert measurements_of(points) == [measurement]


def test_run_without_a_curve_begins_with_none(tmp_path: Path) -> None:
    assert load_curve(tmp_path / "curve.json") == []


@pytest.mark.parametrize("text", ["{", "[]", '{"points": [{"minutes": "soon"}]}', '{"points": [{"weather": 1}]}'])
def test_broken_curve_is_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "curve.json").write_text(text)
    with pytest.raises(RunError, match=r"curve\.json cannot be read: .*; remove it, or choose another --out\.$"):
        load_curve(tmp_path / "curve.json")
