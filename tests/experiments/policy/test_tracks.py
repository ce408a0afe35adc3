"""A robot that stands, and a human who crosses its view at 1 m/s, 3 m ahead."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.policy.tracks import measure_tracks
from readygo.common.arrays import Float64Array
from readygo.common.maps import GridFrame, OccupancyMap, sight_of_occupancy
from readygo.common.perception.grid import SHAPE
from readygo.common.perception.people import CHANNELS
from readygo.common.robot import Clock
from readygo.services.trainer.perception.labels import labels_of
from readygo.services.trainer.perception.looks import Looks
from tests.services.trainer.perception.conftest import CAMERA, ROBOT

STEPS, EVERY, SPEED_MPS = 40, 4, 1.0
HALL = OccupancyMap(
    frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1), occupied=np.zeros((60, 90), np.bool_)
)
MAPS = SimpleNamespace(robot=HALL, human=HALL, sight=sight_of_occupancy(HALL))


def recorded() -> SimpleNamespace:
    humans = np.zeros((STEPS, 1, 4))
    humans[:, 0, 0], humans[:, 0, 1] = 5.0, 3.0 + SPEED_MPS * Clock().dt_s * (np.arange(STEPS) - STEPS / 2)
    pictured = np.zeros(STEPS, np.bool_)
    pictured[::EVERY] = True
    return SimpleNamespace(
        poses=np.tile([2.0, 3.0, 0.0, 0.0], (STEPS, 1)),
        pictured=pictured,
        episode_of_sample=np.zeros(STEPS, np.int64),
        episodes=[SimpleNamespace(first_sample=0, sample_count=STEPS)],
        humans_xyzyaw=tuple(humans),
        clock=Clock(),
    )


def looks_of_labels(dataset: SimpleNamespace) -> Looks:
    samples = np.flatnonzero(dataset.pictured)
    labels = labels_of(dataset, samples, CAMERA, HALL, MAPS.sight)  # type: ignore[arg-type]
    return SimpleNamespace(labels=labels, episode=np.zeros(len(samples), np.int64))  # type: ignore[return-value]


def answers_of(looks: Looks, *, bearing_off: float = 0.0) -> list[Float64Array]:
    """What a network tells that errs by `bearing_off` [rad], and knows no velocity."""
    answers = []
    for bearing, distance_m, _, _ in looks.labels.people[:, 0].tolist():
        answer = np.zeros((CHANNELS, *SHAPE))
        answer[:, 5, 5] = 0.9, bearing + bearing_off, distance_m, 0.0, 0.0, 0.02, 0.05, 1.0, 1.0
        answers.append(answer)
    return answers


def test_velocity_of_a_track_follows_from_the_places() -> None:
    dataset = recorded()
    looks = looks_of_labels(dataset)
    found = measure_tracks(answers_of(looks), looks, dataset, ROBOT, MAPS)  # type: ignore[arg-type]
    assert found.people == STEPS // EVERY
    assert found.tracked == 1.0
    assert found.place_m < 0.02
    assert 0.0 < found.velocity_mps < 0.1


def test_tracks_away_from_people_are_none_of_them_and_what_is_told_wrong_shows() -> None:
    dataset = recorded()
    looks = looks_of_labels(dataset)
    off = 0.3 / 3.0
    near = measure_tracks(answers_of(looks, bearing_off=off), looks, dataset, ROBOT, MAPS)  # type: ignore[arg-type]
    assert near.place_m == pytest.approx(0.3, abs=0.08)
    far = measure_tracks(answers_of(looks, bearing_off=3 * off), looks, dataset, ROBOT, MAPS)  # type: ignore[arg-type]
    assert far.tracked == 0.0
    assert math.isnan(far.place_m)
    assert math.isnan(far.across_r2)


def test_r2_is_of_both_directions_of_people_who_cross() -> None:
    dataset = recorded()
    back = recorded()
    back.humans_xyzyaw = tuple(np.stack(dataset.humans_xyzyaw)[::-1])
    both = SimpleNamespace(
        poses=np.concatenate([dataset.poses, back.poses]),
        pictured=np.concatenate([dataset.pictured, back.pictured]),
        episode_of_sample=np.repeat([0, 1], STEPS),
        episodes=[SimpleNamespace(first_sample=k * STEPS, sample_count=STEPS) for k in range(2)],
        humans_xyzyaw=dataset.humans_xyzyaw + back.humans_xyzyaw,
        clock=Clock(),
    )
    samples = np.flatnonzero(both.pictured)
    labels = labels_of(both, samples, CAMERA, HALL, MAPS.sight)  # type: ignore[arg-type]
    looks: Looks = SimpleNamespace(labels=labels, episode=both.episode_of_sample[samples])  # type: ignore[assignment]
    found = measure_tracks(answers_of(looks), looks, both, ROBOT, MAPS)  # type: ignore[arg-type]
    # The network tells no velocities: what is explained follows from places.
    assert 0.5 < found.across_r2 <= 1.0
