import numpy as np
import pytest

from readygo.common.frames import matrix_from_quat
from readygo.common.scenes.embedded.surfaces import ALL_FACES, Surfaces, UnlitPoints, fibonacci_sphere
from tests.common.scenes.embedded.parts import rows_of

GREY = (0.5, 0.5, 0.5)


@pytest.fixture
def build() -> Surfaces:
    return Surfaces(np.random.default_rng(0))


def test_cleared_samples_are_those_added_before(build: Surfaces) -> None:
    build.patch((0, 0, 0), (1.0, 0, 0), (0, 1.0, 0), 0.1, (0.5, 0.5, 0.5))
    moved = build.at(0.5, 0.5, yaw_deg=90)
    moved.clear((-0.21, -0.21, -0.01), (0.21, 0.21, 0.01))
    moved.patch((-0.05, -0.05, 0), (0.1, 0, 0), (0, 0.1, 0), 0.1, (1.0, 0.0, 0.0))
    position = build.samples().position_m
    assert len(position) == 100 - 16 + 1
    np.testing.assert_allclose(position[-1], [0.5, 0.5, 0.0], atol=1e-12)


def test_patch_spreads_its_samples_evenly_and_faces_along_the_cross_product(build: Surfaces) -> None:
    build.patch((1, 2, 3), (0.4, 0, 0), (0, 0, 0.2), (0.1, 0.2), lambda u, v: np.stack([u, v, 0 * u], axis=1))
    samples = build.samples()
    np.testing.assert_allclose(samples.position_m, [[1.05 + 0.1 * k, 2, 3.1] for k in range(4)])
    np.testing.assert_allclose(samples.normal, np.tile((0, -1, 0), (4, 1)))
    np.testing.assert_allclose(samples.colour, [[0.05 + 0.1 * k, 0.1, 0] for k in range(4)])
    np.testing.assert_allclose(samples.sigma_m[0], (0.06, 0.12, 0.004))


def test_axes_of_a_sample_are_tangent_bitangent_and_normal(build: Surfaces) -> None:
    build.at(1, 1, yaw_deg=30).patch((0, 0, 0), (0.4, 0, 0), (0, 0, 0.2), 0.4, GREY)
    R = matrix_from_quat(build.samples().quats_wxyz())[0]
    turned = np.array([np.cos(np.pi / 6), 0.5, 0.0])
    np.testing.assert_allclose(R, np.stack([turned, (0, 0, 1), (turned[1], -turned[0], 0)], axis=1), atol=1e-8)


def test_placements_nest(build: Surfaces) -> None:
    inner = build.at(1.0, 2.0, 0.5, yaw_deg=90).at(1.0, 0.0, yaw_deg=90)
    inner.add(np.array([[0.1, 0.0, 0.0]]), (1, 0, 0), (0, 0, 1), 0.01, GREY)
    np.testing.assert_allclose(build.samples().position_m, [[0.9, 3.0, 0.5]], atol=1e-9)


@pytest.mark.parametrize("radius_m", [0.0, 0.1])
def test_faces_of_a_box_look_outwards(build: Surfaces, radius_m: float) -> None:
    build.box((-1, -1, -1), (1, 1, 1), 0.25, GREY, radius_m=radius_m)
    samples = build.samples()
    assert len(samples.position_m) == 64 * len(ALL_FACES)
    assert ((samples.position_m * samples.normal).sum(axis=1) > 0.9).all()
    assert np.abs(samples.position_m).max() <= 1.0 + 1e-9


def test_named_faces_are_the_only_ones(build: Surfaces) -> None:
    build.box((-1, -1, -1), (1, 1, 1), 0.5, GREY, faces=("front", "top"), solid=False)
    assert {tuple(normal) for normal in build.samples().normal.tolist()} == {(0.0, -1.0, 0.0), (0.0, 0.0, 1.0)}
    with pytest.raises(ValueError, match="concatenate"):
        build.solid_points_m()


def test_solid_fills_voxels_of_five_centimetres_and_stays_inside(build: Surfaces) -> None:
    build.at(1.0, 0.0).solid((0.0, 0.0, 0.0), (0.4, 0.1, 0.2))
    points = build.solid_points_m()
    assert points.min(axis=0).tolist() == pytest.approx([1.004, 0.004, 0.004])
    assert points.max(axis=0).tolist() == pytest.approx([1.396, 0.096, 0.196])
    assert len(np.unique(np.floor(points / 0.05), axis=0)) == 8 * 2 * 4


def radii(samples: UnlitPoints) -> np.ndarray:
    return np.hypot(samples.position_m[:, 0], samples.position_m[:, 1])


def test_tube_narrows_towards_its_top_and_is_closed_there(build: Surfaces) -> None:
    build.tube((0, 0, 1), 0.5, 0.3, 0.2, 0.05, GREY)
    samples = build.samples()
    side = samples.normal[:, 2] < 0.9
    height = samples.position_m[side, 2] - 1
    np.testing.assert_allclose(radii(samples)[side], 0.3 - 0.2 * height, atol=1e-6)
    assert (samples.normal[side, 2] > 0).all()
    np.testing.assert_allclose(samples.position_m[~side, 2], 1.5)
    assert radii(samples)[~side].max() < 0.2
    assert (~side).sum() > 10


def test_disc_fills_its_circle_and_looks_up_or_down(build: Surfaces) -> None:
    build.disc((0, 0, 2), 0.4, 0.1, GREY, up=False)
    samples = build.samples()
    np.testing.assert_allclose(sorted(set(radii(samples).round(6))), [0.05, 0.15, 0.25, 0.35])
    np.testing.assert_allclose(samples.normal[:, 2], -1.0)


def test_blob_lies_on_its_ellipsoid(build: Surfaces) -> None:
    build.blob((1, 0, 0), (0.3, 0.2, 0.1), 0.05, GREY)
    samples = build.samples()
    ratio = (samples.position_m - (1, 0, 0)) / (0.3, 0.2, 0.1)
    np.testing.assert_allclose(np.linalg.norm(ratio, axis=1), 1.0, atol=1e-6)
    gradient = ratio / (0.3, 0.2, 0.1)
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(samples.normal, gradient, atol=1e-6)
    np.testing.assert_allclose((samples.normal * samples.tangent).sum(axis=1), 0.0, atol=1e-9)


def test_rod_is_a_string_between_its_ends(build: Surfaces) -> None:
    build.rod((0, 0, 0), (0, 0.8, 0.6), 0.02, GREY)
    samples = build.samples()
    assert len(samples.position_m) == 10
    np.testing.assert_allclose(samples.position_m[[0, -1]], [[0, 0.04, 0.03], [0, 0.76, 0.57]])
    np.testing.assert_allclose(samples.tangent, np.tile((0, 0.8, 0.6), (10, 1)))
    assert (samples.facing == 0.0).all()


def test_hidden_layer_of_a_hollow_box_stays_within_it(build: Surfaces) -> None:
    build.fill((0, 0, 0), (1, 0.5, 1), GREY)
    samples = build.samples()
    assert samples.glows.all()
    assert samples.position_m[:, :2].min() > 0.06
    assert (samples.position_m[:, 2] == 0.3).all()


def test_coarser_spacing_makes_fewer_samples() -> None:
    counts = []
    for factor in (1.0, 2.0):
        build = Surfaces(np.random.default_rng(0), spacing_factor=factor)
        build.patch((0, 0, 0), (1, 0, 0), (0, 1, 0), 0.1, GREY)
        counts.append(len(build.samples().position_m))
    assert counts == [100, 25]


def test_directions_spread_over_the_sphere() -> None:
    directions = fibonacci_sphere(500)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-8)
    np.testing.assert_allclose(directions.mean(axis=0), 0.0, atol=0.01)
    nearest = np.sort(directions @ directions.T, axis=1)[:, -2]
    assert np.degrees(np.arccos(nearest)).min() > 5.0


def test_shapes_are_sampled_as_they_were(golden_figures) -> None:
    """Each shape in a turned, mirrored and tinted placement, a box of them cleared."""
    tints = iter([np.array([[0.9, 0.1, 0.0], [0.0, 0.7, 0.2], [0.1, 0.0, 0.8]])] * 9)
    build = Surfaces(np.random.default_rng(1), spacing_factor=1.3, mirror=(-1.0, 1.0), tints=tints)
    place = build.at(0.7, -0.4, 0.3, yaw_deg=37.0)
    place.patch((0.1, 0.2, 0.0), (0.9, 0.1, 0), (0, 0.1, 0.7), (0.11, 0.07), (0.3, 0.5, 0.9), softness=0.8)
    place.box((-0.4, -0.3, 0.1), (0.5, 0.6, 0.7), 0.13, (0.8, 0.5, 0.3), radius_m=0.05, faces=("front", "left", "top"))
    place.tube((0.3, 0.1, 0.2), 0.6, 0.3, 0.2, 0.09, (0.2, 0.9, 0.3))
    place.clear((0.2, -0.1, 0.0), (0.45, 0.4, 0.5))
    place.disc((0.2, 0.5, 0.4), 0.3, 0.08, (0.6, 0.4, 0.1), up=False)
    place.blob((-0.3, 0.2, 0.5), (0.2, 0.3, 0.1), 0.07, (0.9, 0.1, 0.6))
    place.rod((0.1, 0.1, 0.1), (0.5, -0.2, 0.9), 0.02, (0.4, 0.4, 0.7))
    place.fill((-0.2, -0.2, 0.1), (0.2, 0.3, 0.6), (0.5, 0.2, 0.2))
    samples = build.samples()
    golden_figures("embedded/shapes", *rows_of(samples), samples.quats_wxyz())
    golden_figures("embedded/shapes solid", build.solid_points_m())
