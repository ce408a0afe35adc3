import numpy as np
import pytest

from readygo.common.scenes.embedded.outdoors import build_outdoors
from readygo.common.scenes.embedded.surfaces import UnlitPoints
from tests.common.scenes.embedded.parts import rows_of, samples_of


@pytest.fixture(scope="module")
def garden() -> UnlitPoints:
    return samples_of(build_outdoors)


def test_everything_glows(garden: UnlitPoints) -> None:
    assert garden.glows.all()
    assert 0.0 <= garden.colour.min() <= garden.colour.max() <= 1.0


def test_sky_is_ninety_metres_away_bluer_above_than_at_the_horizon(garden: UnlitPoints) -> None:
    distance = np.linalg.norm(garden.position_m, axis=1)
    sky = distance > 85.0
    np.testing.assert_allclose(distance[sky], 90.0, atol=1e-5)
    inwards = -(garden.normal[sky] * garden.position_m[sky]).sum(axis=1) / 90.0
    np.testing.assert_allclose(inwards, 1.0, atol=1e-6)
    height = garden.position_m[sky, 2]
    blue = garden.colour[sky, 2] - garden.colour[sky, 0]
    assert blue[height > 60].mean() > blue[height < 10].mean() + 0.1


def test_lawn_surrounds_the_house_and_does_not_reach_below_it(garden: UnlitPoints) -> None:
    x, y, z = garden.position_m.T
    lawn = (z == -0.35) & (garden.normal[:, 2] == 1.0)
    reach = 2.0 * garden.sigma_m[lawn, 0]
    assert ((np.abs(x[lawn]) > 5.4 + reach) | (np.abs(y[lawn]) > 5.0 + reach)).all()
    turn = np.arctan2(y[lawn], x[lawn])
    assert np.histogram(turn, bins=12, range=(-np.pi, np.pi))[0].min() > 20
    assert (garden.colour[lawn, 1] > garden.colour[lawn, 2]).all()


def test_trees_stand_around_the_house(garden: UnlitPoints) -> None:
    x, y, z = garden.position_m.T
    crowns = (z > 2.0) & (z < 8.0) & (np.hypot(x, y) < 20.0)
    assert np.hypot(x[crowns], y[crowns]).min() > 8.0
    assert (np.histogram(np.arctan2(y[crowns], x[crowns]), bins=8, range=(-np.pi, np.pi))[0] > 0).all()


def test_garden_is_as_it_was(garden: UnlitPoints, golden_figures) -> None:
    golden_figures("embedded/garden", *rows_of(garden))
