import math

import numpy as np
import pytest

from readygo.common.perception.grid import SHAPE
from readygo.common.perception.people import CHANNELS
from readygo.services.trainer.perception.metrics import PerceptionMetrics, measure_perception

RAYS = np.full((1, SHAPE[1]), 2.0)


def one_map(*rows: tuple[float, ...]) -> np.ndarray:
    """Told humans: probability, bearing, distance, along, across."""
    answers = np.zeros((CHANNELS, *SHAPE))
    for k, row in enumerate(rows):
        answers[:5, 2, 3 + 4 * k] = row
    return answers


def measured(told: list[tuple[float, ...]], true: list[tuple[float, ...]], shown: list[bool]) -> PerceptionMetrics:
    people = np.full((1, 8, 4), np.nan, np.float32)
    people[0, : len(true)] = np.array(true).reshape(-1, 4)
    visible = np.zeros((1, 8), np.bool_)
    visible[0, : len(shown)] = shown
    return measure_perception([one_map(*told)], RAYS * 1.1, people, visible, RAYS.astype(np.float32))


def test_errors_of_one_who_is_found() -> None:
    metrics = measured([(0.9, 0.05, 2.2, 0.5, 0.0)], [(0.0, 2.0, 1.0, -0.2)], [True])
    assert metrics.bearing_deg == pytest.approx(math.degrees(0.05))
    assert metrics.distance == pytest.approx(0.1)
    assert metrics.average_precision == pytest.approx(1.0)
    assert (metrics.missed, metrics.false_per_image) == (0.0, 0.0)
    assert (metrics.along_mae_mps, metrics.across_mae_mps) == pytest.approx((0.5, 0.2))
    assert metrics.rays == pytest.approx(0.1)


def test_one_who_is_missed_and_one_who_is_not_there() -> None:
    metrics = measured([(0.9, 0.6, 2.0, 0.0, 0.0)], [(-0.6, 2.0, 0.0, 0.0)], [True])
    assert (metrics.missed, metrics.false_per_image, metrics.average_precision) == (1.0, 1.0, 0.0)
    far = measured([], [(-0.6, 8.0, 0.0, 0.0)], [True])
    assert far.missed == 0.0


def test_hidden_human_is_neither_missed_nor_a_false_alarm() -> None:
    for told in ([], [(0.9, 0.0, 2.0, 0.0, 0.0)]):
        metrics = measured(told, [(0.0, 2.0, 0.0, 0.0)], [False])
        assert (metrics.missed, metrics.false_per_image) == (0.0, 0.0)


def test_precision_falls_with_likelier_false_alarms() -> None:
    sure = [(0.5, 0.0, 2.0, 0.0, 0.0), (0.9, 0.6, 2.0, 0.0, 0.0)]
    assert measured(sure, [(0.0, 2.0, 0.0, 0.0)], [True]).average_precision == pytest.approx(0.5)


def test_r2_of_velocities_over_several() -> None:
    told = [(0.9, -0.6, 2.0, 0.9, 0.4), (0.9, 0.0, 2.0, -0.9, 0.4), (0.9, 0.6, 2.0, 0.1, 0.4)]
    true = [(-0.6, 2.0, 1.0, 1.0), (0.0, 2.0, -1.0, -1.0), (0.6, 2.0, 0.0, 0.0)]
    metrics = measured(told, true, [True] * 3)
    assert metrics.along_r2 == pytest.approx(1 - 0.03 / 2.0)
    assert metrics.across_r2 < 0.0
