import numpy as np
import pytest
from numba import njit

from readygo.common.rasterizer.constants import FOV_MARGIN
from readygo.common.rasterizer.cpu.optics import clamp_tangents, optics_of, rotation_rows
from readygo.common.rasterizer.cpu.view import make_view
from readygo.common.simd.memory import load_f16, store_f16

WIDTH, HEIGHT = 97, 64
K = np.array([[50.0, 0.0, 40.0], [0.0, 60.0, 30.0], [0.0, 0.0, 1.0]])
VIEW = make_view(np.eye(4), K, HEIGHT, WIDTH)


@njit
def _clamp(view, tangents, out):
    u, v = clamp_tangents(optics_of(view), load_f16(tangents, 0), load_f16(tangents, 0))
    store_f16(out, 0, u)
    store_f16(out, 16, v)


@njit
def _rows(R, out):
    rows = rotation_rows(R)
    for k in range(9):
        store_f16(out, 16 * k, rows[k])


def test_tangents_are_clamped_a_margin_beyond_the_borders_of_the_image() -> None:
    tangents, out = np.linspace(-4.0, 4.0, 16).astype(np.float32), np.empty(32, np.float32)
    _clamp(VIEW, tangents, out)
    margins = FOV_MARGIN * 0.5 * WIDTH / 50.0, FOV_MARGIN * 0.5 * HEIGHT / 60.0
    limits = (
        (-40.0 / 50.0 - margins[0], 57.0 / 50.0 + margins[0]),
        (-30.0 / 60.0 - margins[1], 34.0 / 60.0 + margins[1]),
    )
    for found, (low, high) in zip(out.reshape(2, 16), limits, strict=True):
        assert found == pytest.approx(np.clip(tangents, low, high), abs=1e-6)


def test_last_pixels_and_tiles_are_those_of_the_image() -> None:
    optics = optics_of(VIEW)
    assert (optics.x_last, optics.y_last, optics.columns) == (96.0, 63.0, 7)
    assert optics_of(make_view(np.eye(4), K, HEIGHT, 96)).columns == 6


def test_rotation_is_spread_row_by_row() -> None:
    out = np.empty(9 * 16, np.float32)
    _rows(np.arange(9.0).reshape(3, 3), out)
    assert np.array_equal(out.reshape(9, 16), np.repeat(np.arange(9.0)[:, None], 16, axis=1))
