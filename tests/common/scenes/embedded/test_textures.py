import numpy as np
import pytest

from readygo.common.scenes.embedded.textures import (
    Texture,
    fabric,
    folds,
    lattice_noise,
    mix_colours,
    painting,
    plain,
    rug_pattern,
    shade_colour,
    stripes,
    tiles,
    value_noise,
    wood,
)

RED, BLUE, GREEN = (0.8, 0.2, 0.1), (0.1, 0.2, 0.8), (0.2, 0.7, 0.2)
U, V = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 1.2, 61), np.linspace(0, 0.9, 46)))


@pytest.mark.parametrize(
    "texture",
    [
        plain(RED), fabric(RED), wood(RED), stripes(RED, BLUE, 0.1), tiles(RED, BLUE, 0.2, 0.1), folds(RED),
        rug_pattern(1.2, 0.9, (RED, BLUE, GREEN)), *(painting(motif, 1.2, 0.9) for motif in range(5)),
    ],
)  # fmt: skip
def test_textures_are_colours_that_vary_and_repeat_exactly(texture: Texture) -> None:
    colours = texture(U, V)
    assert colours.shape == (len(U), 3)
    assert colours.min() >= 0.0
    assert colours.max() <= 1.05
    assert colours.std(axis=0).max() > 0.001
    np.testing.assert_array_equal(texture(U, V), colours)


@pytest.mark.parametrize(
    ("name", "texture"),
    [
        ("usual plain", plain(BLUE)), ("usual fabric", fabric(BLUE)), ("usual wood", wood(GREEN)),
        ("usual stripes", stripes(GREEN, BLUE, 0.11)), ("usual tiles", tiles(GREEN, BLUE, 0.2, 0.14)),
        ("usual folds", folds(GREEN)), ("usual rug", rug_pattern(1.1, 0.8, (RED, BLUE, GREEN))),
        ("usual painting", painting(1, 1.1, 0.8)),
        ("plain", plain(RED, variation=0.2, patch_m=0.3, seed=5)), ("fabric", fabric(RED, seed=4)),
        ("wood", wood(RED, seed=6)), ("wood across", wood(BLUE, along_u=False, contrast=0.5)),
        ("stripes", stripes(RED, BLUE, 0.13)), ("stripes along", stripes(RED, BLUE, 0.13, along_u=True, seed=3)),
        ("tiles", tiles(RED, BLUE, 0.23, 0.11, seed=2)), ("folds", folds(RED, pitch_m=0.17, seed=7)),
        ("rug", rug_pattern(1.2, 0.9, (RED, BLUE, GREEN), seed=8)),
        *((f"painting {motif}", painting(motif, 1.2, 0.9, seed=motif + 2)) for motif in range(5)),
    ],
)  # fmt: skip
def test_texture_is_painted_as_it_was(name: str, texture: Texture, golden_figures) -> None:
    rng = np.random.default_rng(9)
    u, v = rng.uniform(0.0, (1.2, 0.9), (4000, 2)).T
    golden_figures(f"embedded/texture {name}", 5.0 * texture(u, v))


def test_lattice_noise_is_uniform_and_depends_on_place_and_seed() -> None:
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(-50.0, 50.0), np.arange(-50.0, 50.0)))
    noise = lattice_noise(i, j, 3)
    counts, _ = np.histogram(noise, bins=10, range=(0, 1))
    assert counts.min() > 800
    for other in (lattice_noise(j, i, 3), lattice_noise(i, j, 4), lattice_noise(i + 1, j, 3)):
        assert abs(np.corrcoef(noise, other)[0, 1]) < 0.05


def test_value_noise_meets_the_lattice_and_is_smooth_between() -> None:
    i = np.arange(-3.0, 4.0)
    np.testing.assert_array_equal(value_noise(i, i + 2, 5), lattice_noise(i, i + 2, 5))
    x = np.linspace(-2, 2, 4001)
    steps = np.abs(np.diff(value_noise(x, 0.3 * x, 5)))
    assert steps.max() < 0.003


def test_mixed_goes_from_the_first_colour_to_the_second_and_no_further() -> None:
    colours = mix_colours(RED, BLUE, np.array([-1.0, 0.0, 0.5, 2.0]))
    np.testing.assert_allclose(colours, [RED, RED, (0.45, 0.2, 0.45), BLUE])


def test_shade_is_clipped() -> None:
    np.testing.assert_allclose(shade_colour(RED, np.array([0.5, 2.0])), [(0.4, 0.1, 0.05), (1.0, 0.4, 0.2)])


def is_red(colours: np.ndarray) -> np.ndarray:
    return colours[:, 0] > colours[:, 2]


def test_stripes_change_across_their_bands() -> None:
    along = stripes(RED, BLUE, 0.1, along_u=True)(np.full(4, 0.03), np.array([0.05, 0.15, 0.25, 0.35]))
    across = stripes(RED, BLUE, 0.1)(np.array([0.05, 0.15, 0.25, 0.35]), np.full(4, 0.03))
    assert is_red(along).tolist() == is_red(across).tolist() == [True, False, True, False]


@pytest.mark.parametrize("along_u", [True, False])
def test_grain_of_wood_runs_along_it(along_u: bool) -> None:
    x, still = np.linspace(0, 0.2, 200), np.full(200, 0.1)
    over_u, over_v = (wood(RED, along_u=along_u)(*place)[:, 0].std() for place in ((x, still), (still, x)))
    along, across = (over_u, over_v) if along_u else (over_v, over_u)
    assert along < 0.5 * across


def test_tiles_have_joints_between_them_and_rows_are_shifted() -> None:
    texture = tiles(RED, BLUE, 0.2, 0.1)
    assert is_red(texture(np.array([0.1, 0.2, 0.1, 0.2]), np.array([0.05, 0.05, 0.15, 0.15]))).tolist() == [
        True,
        False,
        False,
        True,
    ]
    assert not is_red(texture(np.array([0.1]), np.array([0.1]))).any()


def test_rug_has_its_border_around_the_field() -> None:
    colours = rug_pattern(1.2, 0.9, (RED, GREEN, BLUE))(
        np.array([0.05, 1.15, 0.6, 0.6]), np.array([0.45, 0.45, 0.05, 0.45])
    )
    assert colours.argmax(axis=1).tolist() == [2, 2, 2, 1]


def test_motifs_differ_and_come_round() -> None:
    pictures = [painting(motif, 1.2, 0.9)(U, V) for motif in range(6)]
    for k in range(1, 5):
        assert np.abs(pictures[0] - pictures[k]).mean() > 0.05
    np.testing.assert_array_equal(pictures[0], pictures[5])
