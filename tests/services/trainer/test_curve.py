import math

import cv2
import numpy as np
import pytest

from readygo.services.trainer.curve import (
    BOTTOM_PX,
    COLOURS_BGR,
    HEIGHT_PX,
    LEFT_PX,
    RIGHT_PX,
    TOP_PX,
    WIDTH_PX,
    draw_curves,
    draw_history,
)


@pytest.fixture
def drawn(tmp_path):
    """Draws curves; returns the picture, B, G, R."""

    def draw(curves):
        draw_curves(tmp_path / "loss.png", curves, title="t", x_label="x")
        return cv2.imread(str(tmp_path / "loss.png"))

    return draw


def rows_of(picture, colour_bgr):
    """Mean row of a colour in each column of the plot that has it."""
    hit = np.all(picture == np.array(colour_bgr, np.uint8), axis=2)[TOP_PX + 1 :, LEFT_PX + 1 : WIDTH_PX - RIGHT_PX]
    return {
        column + LEFT_PX + 1: TOP_PX + 1 + np.flatnonzero(hit[:, column]).mean()
        for column in np.flatnonzero(hit.any(axis=0))
    }


def test_equal_factors_are_equal_heights_and_the_first_point_is_at_the_left(drawn):
    rows = rows_of(drawn({"a": [(0.0, 1.0), (50.0, 0.1), (100.0, 0.01)]}), COLOURS_BGR[0])
    # Ticks go from 0.01 to 1: the curve reaches from corner to corner.
    width = WIDTH_PX - LEFT_PX - RIGHT_PX
    for column in (LEFT_PX + 40, LEFT_PX + 200, LEFT_PX + 400):
        x = (column - LEFT_PX) / width
        assert rows[column] == pytest.approx(TOP_PX + x * (HEIGHT_PX - TOP_PX - BOTTOM_PX), abs=3)


def test_curves_have_colours_of_their_own_in_order(drawn):
    picture = drawn({"a": [(0.0, 1.0), (9.0, 1.0)], "gone": [], "b": [(0.0, 0.5), (9.0, 0.5)]})
    first, second = rows_of(picture, COLOURS_BGR[0]), rows_of(picture, COLOURS_BGR[1])
    assert max(first.values()) < min(second.values())
    assert not rows_of(picture, COLOURS_BGR[2])


def test_points_that_have_no_logarithm_are_left_out(drawn):
    plain = drawn({"a": [(0.0, 1.0), (4.0, 0.5), (9.0, 0.2)]})
    odd = drawn({"a": [(0.0, 1.0), (2.0, math.nan), (3.0, 0.0), (4.0, 0.5), (9.0, 0.2)]})
    assert np.array_equal(plain, odd)
    empty = drawn({"a": [(1.0, math.inf)]})
    assert not rows_of(empty, COLOURS_BGR[0])


def test_history_shows_training_above_validation_where_it_is_worse(tmp_path):
    history = [{"samples": 100 * k, "train_loss": 0.5, "validation_loss": 0.1} for k in range(1, 4)]
    draw_history(tmp_path / "loss.png", history)
    picture = cv2.imread(str(tmp_path / "loss.png"))
    training, validation = (rows_of(picture, colour) for colour in COLOURS_BGR[:2])
    assert max(training.values()) < min(validation.values())


def test_single_validation_is_seen_and_no_label_is_cut(tmp_path):
    draw_history(tmp_path / "loss.png", [{"samples": 1_678_976, "train_loss": 2.1, "validation_loss": 0.24}])
    picture = cv2.imread(str(tmp_path / "loss.png"))
    assert rows_of(picture, COLOURS_BGR[0])
    assert rows_of(picture, COLOURS_BGR[1])
    edge = np.concatenate([picture[:, :4].ravel(), picture[:, -4:].ravel(), picture[-2:].ravel()])
    assert (edge == 255).all()


def test_ticks_of_the_samples_are_labelled_below_the_plot(drawn):
    picture = drawn({"a": [(0.0, 1.0), (100.0, 0.1)]})
    below = (picture[HEIGHT_PX - BOTTOM_PX + 4 : HEIGHT_PX - BOTTOM_PX + 30] < 128).all(axis=2).any(axis=0)
    width = WIDTH_PX - LEFT_PX - RIGHT_PX
    for tick in (0, 20, 40, 60, 80, 100):
        column = LEFT_PX + round(tick / 100 * width)
        assert below[column - 14 : column + 15].any(), tick
    assert not below[LEFT_PX + 20 : LEFT_PX + round(0.2 * width) - 20].any()
