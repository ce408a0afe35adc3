"""Light falls in through the windows, from the lamps and from the sun."""

import numpy as np
import pytest

from readygo.common.scenes.embedded.light import Light, draw_light, lights_of
from readygo.common.scenes.embedded.plan import FLAT

WINDOWS = [opening for opening in FLAT.openings if opening.is_window]


def test_every_window_shines_inwards_as_much_as_it_is_large() -> None:
    lights = lights_of(FLAT, Light(), np.ones(2))
    assert len(lights.position_m) == 6 * len(WINDOWS) + len(FLAT.lamps_m)
    for k, window in enumerate(WINDOWS):
        rows = slice(6 * k, 6 * k + 6)
        area_m2 = (window.end_m - window.begin_m) * (window.top_m - window.bottom_m)
        np.testing.assert_allclose(lights.power[rows].sum(axis=0), np.array([5.6, 6.3, 7.2]) * area_m2 / np.pi)
        # A step inwards is a step towards the middle of the flat.
        position, inward = lights.position_m[rows, :2], lights.direction[rows, :2]
        assert (np.linalg.norm(position + inward, axis=1) < np.linalg.norm(position, axis=1)).all()
        assert (lights.position_m[rows, 2] > window.bottom_m).all()
        assert (lights.position_m[rows, 2] < window.top_m).all()


def test_lamps_shine_everywhere() -> None:
    lights = lights_of(FLAT, Light(lamps=2.0), np.ones(2))
    lamps = slice(6 * len(WINDOWS), None)
    assert lights.position_m[lamps].tolist() == [list(lamp) for lamp in FLAT.lamps_m]
    assert (lights.direction[lamps] == 0).all()
    np.testing.assert_allclose(lights.power[lamps], np.tile([2.3, 2.04, 1.6], (len(FLAT.lamps_m), 1)))


def test_mirrored_flat_has_mirrored_windows_and_the_same_sun() -> None:
    lights, mirrored = lights_of(FLAT, Light(), np.ones(2)), lights_of(FLAT, Light(), np.array([-1.0, 1.0]))
    np.testing.assert_array_equal(mirrored.position_m, lights.position_m * [-1, 1, 1])
    np.testing.assert_array_equal(mirrored.direction, lights.direction * [-1, 1, 1])
    np.testing.assert_array_equal(mirrored.sun_direction, lights.sun_direction)


def test_factors_scale_sky_and_sun() -> None:
    lights, bright = lights_of(FLAT, Light(), np.ones(2)), lights_of(FLAT, Light(sky=1.5, sun=0.5), np.ones(2))
    windows = slice(6 * len(WINDOWS))
    np.testing.assert_allclose(bright.power[windows], 1.5 * lights.power[windows])
    np.testing.assert_allclose(bright.sun_power, 0.5 * lights.sun_power)
    assert np.linalg.norm(lights.sun_direction) == pytest.approx(1.0)


def test_drawn_light_goes_from_dull_to_clear_and_from_all_around() -> None:
    drawn = [draw_light(np.random.default_rng(seed)) for seed in range(200)]
    for name, low, high in (("sky", 0.5, 1.3), ("lamps", 0.4, 1.6), ("sun", 0.0, 1.2)):
        values = [getattr(light, name) for light in drawn]
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high
    turns = np.arctan2([light.sun_to[1] for light in drawn], [light.sun_to[0] for light in drawn])
    assert (np.histogram(turns, bins=8, range=(-np.pi, np.pi))[0] > 8).all()
    assert all(light.sun_to[2] >= 0.35 for light in drawn)
