"""What changes over a training."""

import numpy as np
import pytest

from readygo.services.reconstructor.training.config import DensityConfig, GaussiansConfig, GeometryConfig
from readygo.services.reconstructor.training.schedule import TrainingSchedule

PLAN = TrainingSchedule(GaussiansConfig(steps=1000), 2.0)


def test_images_begin_at_a_quarter_and_are_whole_in_the_end() -> None:
    assert [PLAN.fraction(step) for step in (0, 199, 200, 399, 400, 999)] == [4, 4, 2, 2, 1, 1]


def test_degrees_of_colour_come_one_after_the_other() -> None:
    assert [PLAN.sh_degree(step) for step in (0, 100, 250, 900)] == [0, 1, 2, 3]


def test_the_rate_of_means_falls_to_a_hundredth_of_an_extents_share() -> None:
    assert PLAN.means_rate_m(0) == pytest.approx(2.0 * 1.6e-4)
    assert PLAN.means_rate_m(1000) == pytest.approx(2.0 * 1.6e-6)
    rates = PLAN.rates(0)
    np.testing.assert_allclose(rates["sh"][3:], rates["sh"][0] / 20, rtol=1e-6)


def test_densities_change_between_their_times() -> None:
    assert [step + 1 for step in range(1000) if PLAN.changes_density(step)] == [100, 200, 300, 400, 500]


def test_opacities_are_not_reset_in_the_end_and_never_by_mcmc() -> None:
    assert [step + 1 for step in range(1000) if PLAN.resets_opacities(step)] == [200, 400]
    mcmc = TrainingSchedule(GaussiansConfig(steps=1000, density=DensityConfig(method="mcmc")), 1.0)
    assert not any(mcmc.resets_opacities(step) for step in range(1000))


def test_only_surfaces_are_trimmed() -> None:
    surfaces = GaussiansConfig(steps=100, geometry=GeometryConfig(enabled=True))
    assert [step + 1 for step in range(100) if TrainingSchedule(surfaces, 1.0).trims(step)] == [10, 20, 30, 40, 50]
    assert not any(PLAN.trims(step) for step in range(1000))
