"""Adding and removing Gaussians."""

from typing import Literal

import numpy as np
import pytest

from readygo.services.reconstructor.training.config import DensityConfig
from readygo.services.reconstructor.training.density import (
    Sightings,
    add_noise,
    changed_density,
    limit_stretch,
    make_faint,
    reset_opacities,
    shared_opacity,
)
from readygo.services.reconstructor.training.parameters import Gaussians


def some_gaussians(count: int, scale_m: float = 0.01, opacity: float = 0.5) -> Gaussians:
    rng = np.random.default_rng(0)
    return Gaussians.fresh(
        {
            "means_m": rng.normal(size=(count, 3)),
            "quats_wxyz": rng.normal(size=(count, 4)),
            "log_scales": np.full((count, 3), np.log(scale_m)),
            "logits": np.full((count, 1), np.log(opacity / (1 - opacity))),
            "sh": rng.normal(size=(count, 12)),
        }
    )


def sightings(gradients: list[float]) -> Sightings:
    seen = Sightings.none(len(gradients))
    seen.add(np.arange(len(gradients)), np.array(gradients, dtype=np.float32))
    return seen


def changed_by(
    gaussians: Gaussians, seen: Sightings, config: DensityConfig, extent_m: float, rng: np.random.Generator
) -> Gaussians:
    return gaussians.apply(changed_density(gaussians.values, seen, config, extent_m, rng))


CONFIG = DensityConfig(count_max=100)


def test_small_ones_that_want_to_move_are_cloned() -> None:
    changed = changed_by(
        some_gaussians(4, scale_m=0.005), sightings([0, 2, 0, 3]), CONFIG, 1.0, np.random.default_rng(0)
    )
    assert len(changed) == 6
    assert len(np.unique(changed.values["means_m"], axis=0)) == 4 + 2


def test_large_ones_become_two_smaller_ones() -> None:
    gaussians = some_gaussians(3, scale_m=0.09)
    changed = changed_by(gaussians, sightings([0, 2, 0]), CONFIG, 1.0, np.random.default_rng(0))
    assert len(changed) == 4
    assert np.sum(np.isclose(changed.scales_m[:, 0], 0.09 / 1.6)) == 2
    assert not (changed.values["means_m"] == gaussians.values["means_m"][1]).all(axis=1).any()


def test_faint_and_huge_ones_go() -> None:
    gaussians = some_gaussians(4)
    gaussians.values["logits"][0] = -8.0
    gaussians.values["log_scales"][1] = 0.0
    assert len(changed_by(gaussians, sightings([0, 0, 0, 0]), CONFIG, 1.0, np.random.default_rng(0))) == 2


def test_those_that_want_it_most_are_added_within_the_budget() -> None:
    config = DensityConfig(count_max=101)
    gaussians = some_gaussians(100)
    changed = changed_by(gaussians, sightings([*np.linspace(2, 3, 100)]), config, 1.0, np.random.default_rng(0))
    assert len(changed) == 101


def test_reset_makes_opacities_small_and_leaves_smaller_ones() -> None:
    gaussians = some_gaussians(2)
    gaussians.values["logits"][1] = -7.0
    reset_opacities(gaussians, DensityConfig())
    np.testing.assert_allclose(gaussians.opacities, [0.01, 1 / (1 + np.exp(7.0))], rtol=1e-4)


def test_mcmc_moves_the_dead_to_the_living_and_grows_to_the_budget() -> None:
    config = DensityConfig(method="mcmc", count_max=105, growth=0.2)
    gaussians = some_gaussians(100)
    dead = gaussians.values["means_m"][:10].copy()
    gaussians.values["logits"][:10] = -8.0
    changed = changed_by(gaussians, Sightings.none(100), config, 1.0, np.random.default_rng(0))
    assert len(changed) == 105
    assert changed.opacities.min() > 0.005
    assert not (changed.values["means_m"][:, None] == dead[None]).all(axis=2).any()


@pytest.mark.parametrize(("method", "count"), [("mcmc", 4), ("gradients", 2)])
def test_what_is_made_faint_is_moved_within_a_budget_and_else_removed(
    method: Literal["mcmc", "gradients"], count: int
) -> None:
    config, gaussians = DensityConfig(method=method, growth=0.0), some_gaussians(4)
    places = gaussians.values["means_m"][1:3].copy()
    make_faint(gaussians, np.array([False, True, True, False]), config)
    changed = changed_by(gaussians, Sightings.none(4), config, 1.0, np.random.default_rng(0))
    assert len(changed) == count
    assert not (changed.values["means_m"][:, None] == places[None]).all(axis=2).any()


@pytest.mark.parametrize("method", ["mcmc", "gradients"])
def test_state_stays_with_those_that_are_not_changed(method: Literal["mcmc", "gradients"]) -> None:
    config = DensityConfig(method=method, growth=0.3)
    gaussians = some_gaussians(6)
    gaussians.values["logits"][5] = -8.0
    gaussians.updates[:] = np.arange(1, 7)
    for part in (gaussians.first, gaussians.second):
        for array in part.values():
            array += gaussians.updates[:, None]
    colours = gaussians.values["sh"].copy()
    changed = changed_by(gaussians, sightings([0, 2, 0, 0, 0, 0]), config, 1.0, np.random.default_rng(1))
    of = np.array([int(np.flatnonzero((colours == row).all(axis=1))[0]) for row in changed.values["sh"]])
    assert set(of) <= set(range(5))
    old = changed.updates > 0
    np.testing.assert_array_equal(changed.updates[old], of[old] + 1)
    assert 2 <= old.sum() < len(changed)
    for part in (changed.first, changed.second):
        for array in part.values():
            np.testing.assert_array_equal(array, np.broadcast_to(changed.updates[:, None], array.shape))


@pytest.mark.parametrize("copies", [1, 2, 5])
def test_copies_together_are_as_opaque_as_one_was(copies: int) -> None:
    each, shrink = shared_opacity(np.array([0.7]), np.array([copies]))
    assert 1 - (1 - each[0]) ** copies == pytest.approx(0.7)
    # What a ray through the middle gathers along it: the integral over x of 1 - (1 - a exp(-x^2 / 2 s^2))^copies.
    x = np.linspace(-12, 12, 20001)
    gathered = np.trapezoid(1 - (1 - each[0] * np.exp(-0.5 * (x / shrink[0]) ** 2)) ** copies, x)
    assert gathered == pytest.approx(np.trapezoid(0.7 * np.exp(-0.5 * x**2), x), rel=1e-4)


def test_noise_moves_faint_ones_alone() -> None:
    gaussians = some_gaussians(2)
    gaussians.values["logits"][0] = -8.0
    before = gaussians.values["means_m"].copy()
    add_noise(gaussians, 100.0, np.random.default_rng(0))
    assert np.abs(gaussians.values["means_m"] - before)[0].max() > 1e-4
    np.testing.assert_array_equal(gaussians.values["means_m"][1], before[1])


def test_needles_are_shortened_to_a_ratio_of_their_middle_axis() -> None:
    gaussians = some_gaussians(3)
    gaussians.values["log_scales"][:] = np.log([[0.01, 0.5, 0.02], [0.2, 0.001, 0.1], [0.03, 0.03, 0.03]])
    limit_stretch(gaussians)
    assert gaussians.scales_m == pytest.approx(
        np.array([[0.01, 0.4, 0.02], [0.2, 0.001, 0.1], [0.03, 0.03, 0.03]]), rel=1e-5
    )
