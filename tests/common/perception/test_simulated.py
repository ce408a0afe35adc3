import math

import numpy as np
import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.perception.noise import EXACT, PerceptionNoise
from readygo.common.perception.simulated import SimulatedPerception

PLACES, SPEEDS = np.array([[3.0, 1.0], [2.0, -1.0]]), np.array([[1.0, 0.0], [0.0, -0.5]])
BOTH = np.array([True, True])


def looker(noise: PerceptionNoise, seed: int = 0) -> SimulatedPerception:
    return SimulatedPerception(noise, CameraConfig(), np.random.default_rng(seed))


def test_exact_perception_tells_the_truth_of_those_in_view() -> None:
    people = looker(EXACT).look(0.0, (1.0, 1.0, math.pi / 2), PLACES, SPEEDS, np.array([True, False]))
    np.testing.assert_allclose(people.xy_m, [[0.0, -2.0]], atol=1e-9)
    np.testing.assert_allclose(people.v_mps, [[0.0, -1.0]], atol=1e-9)


def test_errors_have_the_sizes_that_are_asked_for() -> None:
    noise = PerceptionNoise(missed=0.2, bearing_deg=4.0, distance=0.1, correlation=0.0)
    told = [looker(noise, seed).look(0.0, (0.0, 0.0, 0.0), PLACES[:1], SPEEDS[:1], BOTH[:1]) for seed in range(2000)]
    found = np.array([people.xy_m[0] for people in told if len(people)])
    away = math.hypot(3, 1)
    assert 1 - len(found) / 2000 == pytest.approx(0.2 * away / 4, abs=0.03)
    assert np.degrees(np.std(np.arctan2(found[:, 1], found[:, 0]))) == pytest.approx(4.0, rel=0.1)
    assert np.std(np.log(np.hypot(*found.T))) == pytest.approx(0.1, rel=0.1)


def test_errors_hang_together_over_time() -> None:
    perception = looker(PerceptionNoise(missed=0.0, correlation=0.9))
    tracks = []
    for step in range(3000):
        people = perception.look(0.1 * step, (0.0, 0.0, 0.0), PLACES[:1], SPEEDS[:1], BOTH[:1])
        tracks.append(np.arctan2(*people.xy_m[0][::-1]))
    off = np.array(tracks) - np.mean(tracks)
    assert np.mean(off[1:] * off[:-1]) / np.mean(off**2) == pytest.approx(0.9, abs=0.05)


def test_unknown_velocity_says_so() -> None:
    people = looker(PerceptionNoise(missed=0.0)).look(0.0, (0.0, 0.0, 0.0), PLACES, SPEEDS, BOTH)
    assert people.v_mps == pytest.approx(np.zeros((2, 2)))
    assert np.linalg.eigvalsh(people.velocity_cov).min() > 2.0
