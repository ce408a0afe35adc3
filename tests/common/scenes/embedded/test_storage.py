from collections.abc import Callable

import numpy as np
import pytest

from readygo.common.scenes.embedded import storage
from readygo.common.scenes.embedded.surfaces import Surfaces
from tests.common.scenes.embedded.parts import extent, rows_of, samples_of

OAK = (0.66, 0.48, 0.31)


@pytest.mark.parametrize(
    ("draw", "low", "high"),
    [
        (lambda build: storage.bookshelf(build, 1.5, 1.95, OAK), (-0.75, -0.28, 0.0), (0.75, 0.0, 1.95)),
        (lambda build: storage.sideboard(build, 1.4, 0.78, OAK), (-0.7, -0.44, 0.0), (0.7, 0.0, 0.78)),
        (lambda build: storage.wardrobe(build, 2.0, OAK), (-1.0, -0.63, 0.0), (1.0, 0.0, 2.1)),
        (lambda build: storage.kitchen_counter(build, 3.0, OAK, modules=5), (0.0, -0.63, 0.0), (3.0, 0.0, 0.91)),
        (lambda build: storage.backsplash(build, 0.5, 1.5, 1.4), (0.5, -0.006, 0.91), (1.5, -0.006, 1.4)),
        (lambda build: storage.wall_cupboard(build, 1.3, OAK, modules=3), (0.0, -0.36, 1.42), (1.3, 0.0, 2.15)),
        (lambda build: storage.oven(build, 1.0), (0.71, -0.64, 0.14), (1.29, -0.07, 1.06)),
        (storage.fridge, (-0.33, -0.69, 0.03), (0.33, 0.0, 1.82)),
        (lambda build: storage.sink(build, 1.0), (0.74, -0.5, 0.91), (1.26, -0.1, 1.18)),
    ],
    ids=("bookshelf", "sideboard", "wardrobe", "counter", "backsplash", "wall cupboard", "oven", "fridge", "sink"),
)
def test_piece_fills_its_place_before_the_wall(
    draw: Callable[[Surfaces], None], low: tuple[float, ...], high: tuple[float, ...]
) -> None:
    lowest, highest = extent(samples_of(draw))
    np.testing.assert_allclose(lowest, low, atol=0.08)
    np.testing.assert_allclose(highest, high, atol=0.08)


def test_every_shelf_is_nearly_full_of_books() -> None:
    samples = samples_of(lambda build: storage.bookshelf(build, 1.5, 2.08, OAK, shelves=4))
    x, y, z = samples.position_m.T
    for board_m in (0.05, 0.55, 1.05, 1.55):
        books = (np.abs(z - board_m - 0.15) < 0.06) & (y < -0.15) & (np.abs(x) < 0.7)
        full = np.histogram(x[books], bins=28, range=(-0.7, 0.7))[0] > 0
        assert full.mean() > 0.7


def test_other_seed_puts_up_other_books_on_the_same_shelf() -> None:
    one, same, other = (
        samples_of(lambda build: storage.bookshelf(build, 0.6, 1.0, OAK, shelves=2), seed=s) for s in (0, 0, 1)
    )
    np.testing.assert_array_equal(one.colour, same.colour)
    assert len(one.colour) != len(other.colour) or not np.array_equal(one.colour, other.colour)
    np.testing.assert_allclose(extent(one), extent(other), atol=0.05)


def test_sideboard_has_a_gap_beside_each_door() -> None:
    def gaps(doors: int) -> int:
        samples = samples_of(lambda build: storage.sideboard(build, 1.4, 0.78, OAK, doors=doors))
        dark = (samples.position_m[:, 1] == -0.423) & (samples.normal[:, 1] == -1.0)
        return len(np.unique(samples.position_m[dark, 0].round(3)))

    assert (gaps(1), gaps(3)) == (2, 4)


def test_hollow_pieces_are_opaque_to_light_and_hide_their_floor() -> None:
    for draw in (storage.fridge, lambda build: storage.wardrobe(build, 2.0, OAK)):
        build = Surfaces(np.random.default_rng(0))
        draw(build)
        assert len(build.solid_points_m()) > 1000
        samples = build.samples()
        layer = (samples.position_m[:, 2] == 0.3) & samples.glows
        assert layer.sum() > 20


@pytest.mark.parametrize(
    ("name", "draw"),
    [
        ("bookshelf", lambda build: storage.bookshelf(build, 1.5, 1.95, OAK, shelves=4)),
        ("low bookshelf", lambda build: storage.bookshelf(build, 0.6, 1.0, OAK, shelves=2)),
        ("sideboard", lambda build: storage.sideboard(build, 1.4, 0.78, OAK, doors=3)),
        ("wardrobe", lambda build: storage.wardrobe(build, 2.0, OAK)),
        ("counter", lambda build: storage.kitchen_counter(build, 3.0, OAK, modules=5)),
        ("backsplash", lambda build: storage.backsplash(build, 0.5, 1.5, 1.4)),
        ("wall cupboard", lambda build: storage.wall_cupboard(build, 1.3, OAK, modules=3)),
        ("oven", lambda build: storage.oven(build, 1.1)),
        ("fridge", storage.fridge),
        ("sink", lambda build: storage.sink(build, 1.1)),
    ],
)
def test_piece_is_drawn_as_it_was(name: str, draw: Callable[[Surfaces], None], golden_figures) -> None:
    golden_figures(f"embedded/storage {name}", *rows_of(samples_of(draw, seed=3)))
