import dataclasses
import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.maps import sight_of_occupancy
from readygo.common.perception.noise import EXACT, PERCEIVED, PerceptionNoise
from readygo.common.robot import RobotConfig
from readygo.common.state_simulation.tracks import (
    MEMORY_S,
    UNCONFIRMED_S,
    begin_tracks,
    has_no_tracks,
    is_visible,
    look,
    make_tracks,
    tracker_numbers,
)
from readygo.common.state_simulation.world import ObservationConfig, make_world

POSE = (0.0, 0.0, 0.0)


@pytest.fixture
def world(hall):
    return make_world(hall, sight_of_occupancy(hall), RobotConfig(), EpisodeConfig(), ObservationConfig())


def watch(world, noise: PerceptionNoise, walk, steps: int, seed: int = 0):
    """Tracks of one person that a standing robot looks at."""
    numbers, tracks = tracker_numbers(noise, RobotConfig().clock), make_tracks(1, 1)
    begin_tracks(tracks, 0, seed)
    for step in range(0, steps + 1, numbers.every):
        look(world, numbers, tracks, 0, step, POSE, np.array([walk(step)]), 1)
    return tracks


def test_looks_are_at_whole_steps_of_the_clock() -> None:
    clock = RobotConfig().clock
    assert tracker_numbers(PERCEIVED, clock).every == 2
    assert tracker_numbers(dataclasses.replace(PERCEIVED, rate_hz=4.0), clock).every == 5
    assert tracker_numbers(PERCEIVED, clock).kept == pytest.approx(0.9)
    assert tracker_numbers(EXACT, clock).velocity_mps == 0.0 > tracker_numbers(PERCEIVED, clock).velocity_mps


def test_exact_perception_knows_place_and_velocity(world) -> None:
    tracks = watch(world, EXACT, lambda step: (2.0 + 0.02 * step, 0.5 - 0.03 * step), 40)
    assert tracks.mean[0, 0] == pytest.approx([2.8, -0.7, 0.4, -0.6], abs=0.03)
    assert tracks.seen_step[0].tolist() == [40, -1, -1]


def test_unmeasured_velocity_is_found_from_places(world) -> None:
    noise = PerceptionNoise(missed=0.0, bearing_deg=1.0, distance=0.03)
    tracks = watch(world, noise, lambda step: (3.0, -1.0 + 0.05 * step), 40)
    assert tracks.mean[0, 0, 2:] == pytest.approx([0.0, 1.0], abs=0.35)
    assert 0.0 < tracks.cov[0, 0, 3, 3] < 0.5


def test_person_behind_is_not_seen_and_one_who_leaves_coasts(world) -> None:
    assert is_visible(world, *POSE, 2.0, 0.0)
    assert not is_visible(world, *POSE, -0.9, 0.0)
    assert not is_visible(world, *POSE, 20.0, 0.0)

    def walk(step: int) -> tuple[float, float]:
        return (2.0, 0.0) if step <= 20 else (-0.9, 0.0)

    assert watch(world, EXACT, walk, 20 + round(MEMORY_S * 20)).seen_step[0, 0] == 20
    assert watch(world, EXACT, walk, 24 + round(MEMORY_S * 20)).seen_step[0, 0] == -1


def test_single_detections_are_forgotten_soon(world) -> None:
    def walk(step: int) -> tuple[float, float]:
        return (2.0, 0.0) if step == 0 else (-0.9, 0.0)

    assert watch(world, EXACT, walk, round(UNCONFIRMED_S * 20)).seen_step[0, 0] == 0
    assert watch(world, EXACT, walk, round(UNCONFIRMED_S * 20) + 4).seen_step[0, 0] == -1


def test_misses_grow_with_the_distance(world) -> None:
    def missed(distance_m: float) -> float:
        numbers, tracks = tracker_numbers(PerceptionNoise(missed=0.4), RobotConfig().clock), make_tracks(1, 1)
        begin_tracks(tracks, 0, 3)
        hits = 0
        for step in range(0, 8000, 2):
            look(world, numbers, tracks, 0, step, POSE, np.array([[distance_m, 0.3]]), 1)
            hits += tracks.seen_step[0, 0] == step
        return 1.0 - hits / 4000

    assert missed(4.0) == pytest.approx(0.4, abs=0.06)
    assert missed(1.5) == pytest.approx(0.15, abs=0.06)


def test_false_alarms_come_at_their_rate_and_lie_in_the_view(world) -> None:
    numbers = tracker_numbers(PerceptionNoise(false_alarms_hz=1.0), RobotConfig().clock)
    tracks = make_tracks(1, 1)
    begin_tracks(tracks, 0, 0)
    count = 0
    for step in range(0, 4000, 2):
        look(world, numbers, tracks, 0, step, POSE, np.zeros((1, 2)), 0)
        new = np.flatnonzero(tracks.seen_step[0, 1:] == step) + 1
        count += len(new)
        for m in new:
            x, y = tracks.mean[0, m, :2]
            assert abs(math.degrees(math.atan2(y, x))) <= 50.0
            assert 1.0 <= math.hypot(x, y) <= 6.0
    assert 150 < count < 250


def test_robots_without_tracks_are_known() -> None:
    tracks = make_tracks(3, 2)
    tracks.seen_step[1, 1] = 0
    assert has_no_tracks(tracks).tolist() == [True, False, True]
