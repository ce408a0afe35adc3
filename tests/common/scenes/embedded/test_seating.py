from collections.abc import Callable

import numpy as np
import pytest

from readygo.common.scenes.embedded import seating
from readygo.common.scenes.embedded.surfaces import Surfaces
from tests.common.scenes.embedded.parts import extent, rows_of, samples_of

OAK = (0.66, 0.48, 0.31)
BLUE = (0.1, 0.2, 0.7)


@pytest.mark.parametrize(
    ("draw", "low", "high"),
    [
        (lambda build: seating.sofa(build, OAK), (-1.05, -0.88, 0.0), (1.05, 0.0, 0.81)),
        (lambda build: seating.sofa(build, OAK, width_m=0.9, seats=1), (-0.45, -0.88, 0.0), (0.45, 0.0, 0.81)),
        (lambda build: seating.chair(build, OAK), (-0.21, -0.21, 0.0), (0.21, 0.23, 0.91)),
        (lambda build: seating.office_chair(build, OAK), (-0.32, -0.32, 0.0), (0.32, 0.32, 1.08)),
        (lambda build: seating.table(build, (1.2, 0.8, 0.7), OAK), (-0.6, -0.4, 0.0), (0.6, 0.4, 0.7)),
        (lambda build: seating.round_table(build, 0.4, 0.55, OAK), (-0.4, -0.4, 0.0), (0.4, 0.4, 0.55)),
        (lambda build: seating.bed(build, OAK, BLUE), (-0.87, -2.12, 0.0), (0.87, 0.0, 1.05)),
        (lambda build: seating.pouf(build, OAK), (-0.29, -0.29, 0.0), (0.29, 0.29, 0.41)),
        (lambda build: seating.bench(build, OAK, width_m=1.3), (-0.65, -0.34, 0.0), (0.65, -0.02, 0.45)),
    ],
    ids=("sofa", "armchair", "chair", "office chair", "table", "round table", "bed", "pouf", "bench"),
)
def test_piece_fills_its_place_on_the_floor(
    draw: Callable[[Surfaces], None], low: tuple[float, ...], high: tuple[float, ...]
) -> None:
    lowest, highest = extent(samples_of(draw))
    np.testing.assert_allclose(lowest, low, atol=0.08)
    np.testing.assert_allclose(highest, high, atol=0.08)
    assert lowest[2] >= -1e-9
    assert (highest <= np.array(high) + 0.03).all()


def test_table_has_a_top_on_four_legs_with_room_between_them() -> None:
    samples = samples_of(lambda build: seating.table(build, (1.2, 0.8, 0.7), OAK))
    x, y, z = samples.position_m.T
    legs = z < 0.5
    assert {(sx, sy) for sx, sy in zip(np.sign(x[legs]), np.sign(y[legs]), strict=True)} == {
        (-1, -1), (-1, 1), (1, -1), (1, 1),
    }  # fmt: skip
    assert np.abs(x[legs]).min() > 0.45
    assert np.abs(y[legs]).min() > 0.25
    top = (z == 0.7) & (samples.normal[:, 2] == 1.0)
    assert np.histogram2d(x[top], y[top], bins=6, range=[[-0.6, 0.6], [-0.4, 0.4]])[0].min() > 0


def test_padded_chair_has_a_seat_of_cloth() -> None:
    def seat(padded: tuple[float, float, float] | None) -> np.ndarray:
        samples = samples_of(lambda build: seating.chair(build, OAK, padded=padded))
        top = (np.abs(samples.position_m[:, 2] - 0.46) < 0.02) & (samples.normal[:, 2] > 0.9)
        return samples.colour[top].mean(axis=0)

    np.testing.assert_allclose(seat(None), OAK, atol=0.1)
    np.testing.assert_allclose(seat(BLUE), BLUE, atol=0.1)


def test_throw_lies_across_the_bed() -> None:
    samples = samples_of(lambda build: seating.bed(build, OAK, BLUE))
    blue = (samples.colour[:, 2] > 2 * samples.colour[:, 0]) & (samples.normal[:, 2] > 0.9)
    on_top = blue & (samples.position_m[:, 1] < -1.0)
    assert np.ptp(samples.position_m[on_top, 0]) > 1.4
    assert 0.3 < np.ptp(samples.position_m[on_top, 1]) < 0.5


@pytest.mark.parametrize(
    ("name", "draw"),
    [
        ("sofa", lambda build: seating.sofa(build, OAK, width_m=1.7, seats=3)),
        ("chair", lambda build: seating.chair(build, OAK)),
        ("padded chair", lambda build: seating.chair(build, OAK, padded=BLUE)),
        ("office chair", lambda build: seating.office_chair(build, OAK)),
        ("table", lambda build: seating.table(build, (1.3, 0.8, 0.7), OAK)),
        ("round table", lambda build: seating.round_table(build, 0.43, 0.55, OAK)),
        ("bed", lambda build: seating.bed(build, OAK, BLUE)),
        ("pouf", lambda build: seating.pouf(build, OAK)),
        ("bench", lambda build: seating.bench(build, OAK, width_m=1.3)),
    ],
)
def test_piece_is_drawn_as_it_was(name: str, draw: Callable[[Surfaces], None], golden_figures) -> None:
    golden_figures(f"embedded/seating {name}", *rows_of(samples_of(draw, seed=3)))
