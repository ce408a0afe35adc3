from collections.abc import Callable

import numpy as np
import pytest

from readygo.common.scenes.embedded import decor
from readygo.common.scenes.embedded.surfaces import Surfaces
from tests.common.scenes.embedded.parts import extent, rows_of, samples_of

RED, GREY, BLUE = (0.8, 0.2, 0.1), (0.5, 0.5, 0.5), (0.1, 0.2, 0.8)


@pytest.mark.parametrize(
    ("draw", "low", "high"),
    [
        (lambda build: decor.picture(build, 1, (0.6, 0.8)), (-0.335, -0.035, 1.015), (0.335, 0.0, 1.885)),
        (lambda build: decor.curtain(build, 1.0, 1.3, RED), (1.0, -0.1, 0.03), (1.3, -0.03, 2.4)),
        (lambda build: decor.curtain_rod(build, 1.0, 2.0), (1.0, -0.09, 2.42), (2.0, -0.09, 2.42)),
        (lambda build: decor.potted_plant(build, 1.2), (-0.35, -0.35, 0.0), (0.35, 0.35, 1.3)),
        (decor.floor_lamp, (-0.21, -0.21, 0.0), (0.21, 0.21, 1.6)),
        (lambda build: decor.table_lamp(build, 0.7), (-0.14, -0.14, 0.7), (0.14, 0.14, 1.1)),
        (lambda build: decor.pendant(build, 1.6), (-0.22, -0.22, 1.6), (0.22, 0.22, 2.6)),
        (decor.ceiling_lamp, (-0.22, -0.22, 2.52), (0.22, 0.22, 2.6)),
        (lambda build: decor.rug(build, 2.0, 1.0, (RED, GREY, BLUE)), (-1.0, -0.5, 0.01), (1.0, 0.5, 0.01)),
        (lambda build: decor.television(build, 0.5), (-0.56, -0.30, 0.5), (0.56, -0.12, 1.24)),
        (lambda build: decor.monitor_desk_set(build, 0.7), (-0.69, -0.34, 0.7), (0.46, -0.02, 1.18)),
        (lambda build: decor.vase(build, 0.7, RED), (-0.14, -0.14, 0.7), (0.14, 0.14, 1.12)),
        (lambda build: decor.fruit_bowl(build, 0.7), (-0.16, -0.16, 0.7), (0.16, 0.16, 0.83)),
        (decor.coat_rack, (-0.5, -0.16, 0.6), (0.5, 0.0, 1.7)),
        (lambda build: decor.radiator(build, 1.2), (-0.6, -0.103, 0.14), (0.6, -0.03, 0.66)),
        (decor.front_door, (-0.45, -0.07, 0.0), (0.45, 0.0, 2.05)),
    ],
    ids=(
        "picture", "curtain", "curtain rod", "potted plant", "floor lamp", "table lamp", "pendant", "ceiling lamp",
        "rug", "television", "monitor", "vase", "fruit bowl", "coat rack", "radiator", "front door",
    ),
)  # fmt: skip
def test_piece_fills_its_place(
    draw: Callable[[Surfaces], None], low: tuple[float, ...], high: tuple[float, ...]
) -> None:
    lowest, highest = extent(samples_of(draw))
    np.testing.assert_allclose(lowest, low, atol=0.1)
    np.testing.assert_allclose(highest, high, atol=0.1)


@pytest.mark.parametrize(
    "draw",
    [
        decor.floor_lamp, decor.ceiling_lamp, lambda build: decor.table_lamp(build, 0.7),
        lambda build: decor.pendant(build, 1.6),
    ],
    ids=("floor lamp", "ceiling lamp", "table lamp", "pendant"),
)  # fmt: skip
def test_lamps_are_on(draw: Callable[[Surfaces], None]) -> None:
    samples = samples_of(draw)
    down = samples.normal[:, 2] == -1.0
    assert down.any()
    assert samples.glows[down].all()
    assert samples.colour[samples.glows].mean() > 0.7


@pytest.mark.parametrize(
    ("draw", "wall"),
    [
        (lambda build: decor.picture(build, 1, (0.6, 0.8)), True),
        (decor.front_door, True),
        (lambda build: decor.rug(build, 0.8, 0.8, (RED, GREY, BLUE)), False),
    ],
    ids=("picture", "front door", "rug"),
)
def test_what_lies_flat_on_a_surface_clears_it(draw: Callable[[Surfaces], None], wall: bool) -> None:
    def surface(build: Surfaces) -> None:
        if wall:
            build.patch((-1, 0, 0), (2, 0, 0), (0, 0, 2.4), 0.1, GREY)
        else:
            build.patch((-1, -1, 0), (2, 0, 0), (0, 2, 0), 0.1, GREY)

    before = len(samples_of(surface).position_m)
    alone = len(samples_of(draw).position_m)
    both = len(samples_of(lambda build: (surface(build), draw(build))[1]).position_m)
    assert before + alone - both > 40


def test_leaves_are_green_and_their_number_is_as_asked() -> None:
    few, many = (samples_of(lambda build, n=n: decor.potted_plant(build, 1.2, leaves=n)) for n in (60, 160))
    assert len(many.position_m) - len(few.position_m) == 100
    leaves = many.colour[-160:]
    assert (leaves[:, 1] > leaves[:, 0]).all()
    assert (leaves[:, 1] > leaves[:, 2]).all()


def test_palm_rises_in_fronds_to_all_sides() -> None:
    samples = samples_of(lambda build: decor.palm(build, 1.5))
    x, y, z = samples.position_m.T
    fronds = z > 0.4
    assert z.max() == pytest.approx(1.5, abs=0.25)
    assert (np.histogram(np.arctan2(y[fronds], x[fronds]), bins=6, range=(-np.pi, np.pi))[0] > 0).all()


@pytest.mark.parametrize(
    ("name", "draw"),
    [
        ("picture 0", lambda build: decor.picture(build, 0, (0.7, 0.6))),
        ("picture 3", lambda build: decor.picture(build, 3, (0.7, 0.6))),
        ("curtain", lambda build: decor.curtain(build, 1.1, 1.5, RED)),
        ("curtain rod", lambda build: decor.curtain_rod(build, 1.1, 2.0)),
        ("plant", lambda build: decor.potted_plant(build, 1.2, leaves=60)),
        ("palm", lambda build: decor.palm(build, 1.5)),
        ("floor lamp", decor.floor_lamp),
        ("table lamp", lambda build: decor.table_lamp(build, 0.7)),
        ("pendant", lambda build: decor.pendant(build, 1.6)),
        ("ceiling lamp", decor.ceiling_lamp),
        ("rug", lambda build: decor.rug(build, 1.4, 0.9, (RED, GREY, BLUE))),
        ("television", lambda build: decor.television(build, 0.5)),
        ("desk set", lambda build: decor.monitor_desk_set(build, 0.7)),
        ("vase", lambda build: decor.vase(build, 0.7, RED)),
        ("fruit bowl", lambda build: decor.fruit_bowl(build, 0.7)),
        ("coat rack", decor.coat_rack),
        ("radiator", lambda build: decor.radiator(build, 1.3)),
        ("front door", decor.front_door),
    ],
)
def test_piece_is_drawn_as_it_was(name: str, draw: Callable[[Surfaces], None], golden_figures) -> None:
    golden_figures(f"embedded/decor {name}", *rows_of(samples_of(draw, seed=3)))
