"""The engine of the CPU: the same on any number of cores."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from readygo.services.reconstructor.training.config import GaussiansConfig
from readygo.services.reconstructor.training.cpu import CpuEngine
from readygo.services.reconstructor.training.density import Sightings
from readygo.services.reconstructor.training.engine import ViewTask
from readygo.services.reconstructor.training.parameters import Gaussians
from readygo.services.reconstructor.training.photos import PhotoStore, open_posed
from readygo.services.reconstructor.training.schedule import TrainingSchedule
from tests.services.reconstructor.training.conftest import VIEWS, true_gaussians

SETTINGS = GaussiansConfig(steps=10, batch=3, sh_degree=0)


@pytest.fixture
def photos(write_posed: Callable[[Path], Path], tmp_path: Path) -> PhotoStore:
    """All views of the small scene."""
    posed = open_posed(write_posed(tmp_path / "posed"), tmp_path / "undistorted")
    return PhotoStore(posed, tuple(range(VIEWS)), 1000, 1)


def tasks(numbers: tuple[int, ...]) -> list[ViewTask]:
    exposure = np.zeros((2, 3), dtype=np.float32)
    return [ViewTask(number=number, exposure=exposure, rng=None, neighbour=None) for number in numbers]


def stepped(photos: PhotoStore, settings: GaussiansConfig = SETTINGS) -> tuple[Gaussians, Sightings]:
    gaussians = true_gaussians()
    gaussians.values["log_scales"][:, 0] += 3.5
    engine = CpuEngine(settings)
    engine.load(gaussians, Sightings.none(len(gaussians)))
    engine.views(photos, tasks((0, 2, 5)), 0)
    engine.change(TrainingSchedule(settings, 1.0).rates(0))
    engine.close()
    assert engine.arrays()[0] is gaussians
    return engine.arrays()


def test_losses_come_in_the_order_of_the_views(photos: PhotoStore) -> None:
    engine = CpuEngine(SETTINGS)
    gaussians = true_gaussians()
    gaussians.values["sh"] += 0.1
    engine.load(gaussians, Sightings.none(len(gaussians)))
    together = [view.loss for view in engine.views(photos, tasks((0, 2, 5)), 0)]
    alone = [engine.views(photos, tasks((number,)), 0)[0].loss for number in (0, 2, 5)]
    assert together == alone
    assert len(set(alone)) == 3


def test_cores_change_nothing(photos: PhotoStore, monkeypatch: pytest.MonkeyPatch) -> None:
    (many, many_seen), alone = stepped(photos), {0}
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: alone)
    one, one_seen = stepped(photos)
    for name, array in many.state().items():
        np.testing.assert_array_equal(one.state()[name], array)
    np.testing.assert_array_equal(one_seen.gradient, many_seen.gradient)
    assert many_seen.views.max() == 3
    scales = np.sort(many.scales_m, axis=1)
    assert (scales[:, 2] <= 20.001 * scales[:, 1]).all()


def test_views_that_show_a_gaussian_are_counted(photos: PhotoStore) -> None:
    gaussians = true_gaussians()
    gaussians.values["means_m"][7] = [0.0, 0.0, -2.0]
    engine = CpuEngine(replace(SETTINGS, batch=2))
    engine.load(gaussians, Sightings.none(len(gaussians)))
    counts = engine.seen_by(photos, [[number] for number in range(VIEWS)], 0.1)
    assert counts[7] == 0
    assert counts.max() == VIEWS
    first, second = (engine.seen_by(photos, [[number]], 0.1) for number in (0, 1))
    assert ((first > 0) != (second > 0)).any()
    np.testing.assert_array_equal(engine.seen_by(photos, [[0], [1]], 0.1), first + second)
    np.testing.assert_array_equal(engine.seen_by(photos, [[0, 1]], 0.1), (first + second).clip(max=1))
    assert (len(engine), engine.gpu_bytes) == (150, 0)
