"""Depth, alpha, mask and normals of the CPU rasterizer."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar, pose_avatar
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.images.images import OUTPUTS, Images
from readygo.common.rasterizer.constants import ALPHA_MAX, ALPHA_MIN, DILATION_PX2, TRANSMITTANCE_MIN
from readygo.common.rasterizer.cpu import slabs as cpu_slabs
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.rasterizer.reference import ReferenceImages, rasterize_reference
from tests.common.rasterizer.drawing import human, images_of, numbered, rgb_of

HEIGHT, WIDTH = 96, 160
MAY_DIFFER = 0.002
"""Share of pixels where float32 and float64 may see another order of depths, or another Gaussian at half of the light
or at alpha 1/255."""


def sky_around(make_cloud) -> GaussianCloud:
    ball = make_cloud(120, low=(-1.0, -1.0, -1.0), high=(1.0, 1.0, 1.0), seed=3)
    direction = ball.means_m / np.linalg.norm(ball.means_m, axis=1, keepdims=True)
    return dataclasses.replace(ball, means_m=direction * np.float32(1800.0), scales_m=ball.scales_m * 400)


def rasterizer(clouds: Sequence[GaussianCloud], avatars: Sequence[Avatar], K: Float64Array) -> CpuRasterizer:
    return CpuRasterizer([pack_cloud(cloud, normals=True) for cloud in clouds], numbered(avatars), K, HEIGHT, WIDTH)


def reference(
    clouds: Sequence[GaussianCloud], avatar: Avatar, humans: Sequence[PosedHuman], T: object, K: object
) -> ReferenceImages:
    bodies = [pose_avatar(avatar, p.root_m, p.pose_axis_angle) for p in humans]
    instances = [np.zeros(sum(len(cloud) for cloud in clouds))]
    instances += [np.full(len(body), number + 1) for number, body in enumerate(bodies)]
    everything = concatenate([*clouds, *bodies])
    return rasterize_reference(everything, T, K, HEIGHT, WIDTH, instances=np.concatenate(instances))


@pytest.fixture(scope="module")
def drawn(make_cloud, camera, avatar: Avatar) -> dict[str, tuple[npt.NDArray[np.generic], npt.NDArray[np.generic]]]:
    """Images of two views of two humans in a cloud before a sky with gaps, and what the reference says of them."""
    clouds = [make_cloud(900, scale_m=0.03), sky_around(make_cloud)]
    humans = [human(-2.6, 0.4, seed=1), human(-1.8, -0.8, seed=2)]
    pairs = []
    for x, y, yaw in ((-4.0, 0.0, 0.0), (-4.2, 1.5, -0.6)):
        T, K = camera(x, y, yaw, WIDTH, HEIGHT)
        images = images_of(rasterizer(clouds, [avatar], K), T, humans, OUTPUTS)
        pairs.append((images, reference(clouds, avatar, humans, T, K)))
    names = ("alpha", "depth_m", "median_depth_m", "mask", "normal")
    return {name: tuple(np.stack([getattr(view[k], name) for view in pairs]) for k in (0, 1)) for name in names}


def test_alpha_is_that_of_the_reference(drawn) -> None:
    alpha, expected = drawn["alpha"]
    assert expected.min() == 0
    assert np.abs(alpha - expected).max() < 0.005
    assert (np.abs(alpha - expected) > 2e-4).mean() < MAY_DIFFER


def test_mean_depth_is_that_of_the_reference(drawn) -> None:
    depth, expected = drawn["depth_m"]
    assert np.isinf(expected).any()
    assert (expected[np.isfinite(expected)] > 1000).any()
    assert np.array_equal(np.isinf(depth), np.isinf(expected))
    assert (~np.isclose(depth, expected, rtol=3e-4)).mean() < MAY_DIFFER


def test_median_depth_is_that_of_the_reference(drawn) -> None:
    depth, expected = drawn["median_depth_m"]
    assert np.isinf(expected).any()
    assert (expected[np.isfinite(expected)] > 1000).any()
    assert (~np.isclose(depth, expected, rtol=1e-5)).mean() < MAY_DIFFER


SMALL_K = np.array([[20.0, 0.0, 10.5], [0.0, 20.0, 8.5], [0.0, 0.0, 1.0]])
SMALL = (17, 21)
BALLS = st.lists(
    st.tuples(
        st.floats(-0.4, 0.4), st.floats(-0.3, 0.3), st.integers(1, 60), st.floats(0.02, 0.4), st.floats(0.05, 1.0)
    ),
    min_size=1,
    max_size=9,
    unique_by=lambda ball: ball[2],
)
"""Round Gaussians: direction x/z, y/z, depth [0.25 m], scale [m], opacity."""


def balls_cloud(balls: Sequence[tuple[float, float, int, float, float]]) -> GaussianCloud:
    return GaussianCloud(
        means_m=np.array([(0.25 * z * x, 0.25 * z * y, 0.25 * z) for x, y, z, *_ in balls], np.float32),
        quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (len(balls), 1)),
        scales_m=np.array([[scale] * 3 for *_, scale, _ in balls], np.float32),
        opacities=np.array([opacity for *_, opacity in balls], np.float32),
        sh=np.zeros((len(balls), 1, 3), np.float32),
    )


def depths_of_a_pixel(cloud: GaussianCloud, u: int, v: int) -> tuple[float, float, float]:
    """Mean and median depth [m], one Gaussian after the other, and how near a decision was to the other side."""
    light, mean, median, margin = 1.0, 0.0, math.inf, math.inf
    for n in np.argsort(cloud.means_m[:, 2]).tolist():
        x, y, z = cloud.means_m[n].tolist()
        J = np.array([[1 / z, 0, -x / z**2], [0, 1 / z, -y / z**2]]) * SMALL_K[0, 0]
        d = np.array([u + 0.5, v + 0.5]) - (SMALL_K @ [x / z, y / z, 1])[:2]
        covariance = float(cloud.scales_m[n, 0]) ** 2 * J @ J.T + DILATION_PX2 * np.eye(2)
        alpha = min(ALPHA_MAX, float(cloud.opacities[n]) * math.exp(-0.5 * d @ np.linalg.inv(covariance) @ d))
        margin = min(margin, abs(alpha - ALPHA_MIN) / ALPHA_MIN, abs(light - TRANSMITTANCE_MIN) / TRANSMITTANCE_MIN)
        if alpha < ALPHA_MIN or light < TRANSMITTANCE_MIN:
            continue
        margin = min(margin, abs(light * (1 - alpha) - 0.5))
        if light >= 0.5 > light * (1 - alpha):
            median = z
        mean, light = mean + alpha * light * z, light * (1 - alpha)
    return mean / (1 - light) if light < 1 else math.inf, median, margin


@settings(max_examples=40, deadline=None)
@given(BALLS)
def test_depths_are_those_of_a_slow_loop_over_pixels_and_gaussians(balls: list[tuple[float, ...]]) -> None:
    cloud = balls_cloud(balls)
    by_reference = rasterize_reference(cloud, np.eye(4), SMALL_K, *SMALL)
    by_cpu = images_of(CpuRasterizer([pack_cloud(cloud)], {}, SMALL_K, *SMALL), np.eye(4), [], OUTPUTS[:4])
    for v, u in np.ndindex(*SMALL):
        mean, median, margin = depths_of_a_pixel(cloud, u, v)
        if margin > 0.01:
            for images in (by_reference, by_cpu):
                assert images.depth_m[v, u] == pytest.approx(mean, rel=2e-3)
                assert images.median_depth_m[v, u] == pytest.approx(median, rel=1e-5)


def test_mask_is_that_of_the_reference(drawn) -> None:
    mask, expected = drawn["mask"]
    assert np.bincount(expected.ravel(), minlength=3).min() > 500
    assert (mask != expected).mean() < MAY_DIFFER


def test_normals_are_those_of_the_reference(drawn) -> None:
    normal, expected = drawn["normal"]
    drawn_at_all = np.linalg.norm(expected, axis=-1) > 0
    assert 0.5 < drawn_at_all.mean() < 1
    assert (np.linalg.norm(normal - expected, axis=-1) > 1e-3).mean() < MAY_DIFFER
    assert np.abs(np.linalg.norm(normal[drawn_at_all], axis=-1) - 1).max() < 1e-5


@pytest.mark.parametrize("outputs", [(), *((name,) for name in OUTPUTS), ("mask", "depth"), OUTPUTS])
def test_whatever_is_asked_for_nothing_else_is_made_and_colours_stay_the_same(
    make_cloud, camera, avatar: Avatar, outputs: tuple[str, ...]
) -> None:
    T, K = camera(-4.0, 0.0, 0.0, WIDTH, HEIGHT)
    humans = [human(-2.6, 0.4)]
    draws = rasterizer([make_cloud(2000)], [avatar], K)
    everything = images_of(draws, T, humans, OUTPUTS)
    images = images_of(draws, T, humans, outputs)
    assert np.array_equal(images.rgb, rgb_of(draws, T, humans))
    for name in OUTPUTS:
        field = name if name in ("rgb", "alpha", "mask", "normal") else f"{name}_m"
        if name in (*outputs, "rgb"):
            assert np.array_equal(getattr(images, field), getattr(everything, field))
        else:
            assert getattr(images, field) is None


def test_images_do_not_depend_on_what_was_drawn_before(make_cloud, camera, avatar: Avatar) -> None:
    K = camera(0.0, 0.0, 0.0, WIDTH, HEIGHT)[1]
    views = [camera(-4.0 + k, 0.3 * k, 0.2 * k, WIDTH, HEIGHT)[0] for k in range(3)]
    humans = [[human(-1.0, 0.0, avatar=k % 2, seed=k)] * k for k in range(3)]
    clouds, avatars = [make_cloud(2500), make_cloud(300, seed=1)], [avatar, avatar]
    used = rasterizer(clouds, avatars, K)
    for k in (2, 0, 1, 2):
        fresh = images_of(rasterizer(clouds, avatars, K), views[k], humans[k], OUTPUTS)
        again = images_of(used, views[k], humans[k], OUTPUTS)
        for field in dataclasses.fields(Images):
            assert np.array_equal(getattr(again, field.name), getattr(fresh, field.name))


def test_one_slab_shows_what_several_show(make_cloud, camera, avatar: Avatar, monkeypatch: pytest.MonkeyPatch) -> None:
    wall = make_cloud(9000, low=(1.0, -1.0, -1.0), high=(1.3, 4.0, 4.0), scale_m=0.12)
    behind = make_cloud(16000, low=(2.0, -8.0, -1.0), high=(9.0, 8.0, 4.0))
    T, K = camera(-1.0, 0.0, 0.0, WIDTH, HEIGHT)
    draws = rasterizer([concatenate([wall, behind]), sky_around(make_cloud)], [avatar], K)
    humans = [human(0.2, 0.2), human(0.6, -0.6, seed=2)]
    several = images_of(draws, T, humans, OUTPUTS)
    records = int(draws._ws.counts[0])
    monkeypatch.setattr(cpu_slabs, "SLAB_SHARES", ())
    one = images_of(draws, T, humans, OUTPUTS)
    assert records < 0.9 * draws._ws.counts[0]
    assert set(np.unique(one.mask)) == {0, 1, 2}
    assert np.array_equal(several.mask, one.mask)
    assert np.array_equal(several.median_depth_m, one.median_depth_m)
    # A finished pixel goes on fading with the rest of its block, by less than TRANSMITTANCE_MIN.
    assert np.abs(several.alpha - one.alpha).max() < 1.01e-4
    assert np.allclose(several.depth_m, one.depth_m, rtol=1.5e-4)
    assert np.abs(several.normal - one.normal).max() < 1e-3


def test_mask_shows_a_human_before_a_wall_and_not_behind_it(make_cloud, camera, avatar: Avatar) -> None:
    wall = make_cloud(9000, low=(1.0, -5.0, -2.0), high=(1.3, 5.0, 5.0), scale_m=0.12)
    T, K = camera(-2.0, 0.0, 0.0, WIDTH, HEIGHT)
    draws = rasterizer([wall], [avatar], K)
    before = images_of(draws, T, [human(0.0, 0.0)], ("mask", "median_depth"))
    behind = images_of(draws, T, [human(3.0, 0.0)], ("mask",))
    half = images_of(draws, T, [human(3.0, 0.0), human(0.0, 0.0)], ("mask",))
    assert (before.mask == 1).sum() > 300
    assert np.median(before.median_depth_m[before.mask == 1]) < 2.4
    assert before.median_depth_m[before.mask == 0].min() > 2.4
    assert behind.mask.max() == 0
    assert np.array_equal(half.mask, 2 * before.mask)


def test_mask_numbers_humans_in_the_order_in_which_they_are_asked_for(make_cloud, camera, avatar: Avatar) -> None:
    T, K = camera(-4.0, 0.0, 0.0, WIDTH, HEIGHT)
    draws = rasterizer([make_cloud(300), make_cloud(90, seed=1)], [avatar, avatar], K)
    one, two = human(-2.6, 0.4, seed=1), human(-2.2, -0.8, seed=2, avatar=1)
    hidden = human(-9.0, 0.0)
    mask = images_of(draws, T, [one, two], ("mask",)).mask
    assert np.bincount(mask.ravel(), minlength=3).min() > 100
    assert np.array_equal(images_of(draws, T, [two, one], ("mask",)).mask, np.array([0, 2, 1])[mask])
    assert np.array_equal(images_of(draws, T, [one, hidden, two], ("mask",)).mask, np.array([0, 1, 3])[mask])


def test_where_nothing_is_there_is_no_depth_nobody_and_no_normal(make_cloud, camera) -> None:
    T, K = camera(0.0, 0.0, 0.0, WIDTH, HEIGHT)
    images = images_of(rasterizer([make_cloud(0)], [], K), T, (), OUTPUTS)
    assert images.alpha.max() == 0
    assert np.isposinf(images.depth_m).all()
    assert np.isposinf(images.median_depth_m).all()
    assert images.mask.max() == 0
    assert np.abs(images.normal).max() == 0


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_normal_of_a_disc_is_its_axis_towards_the_camera(make_cloud, turn: float) -> None:
    # The disc's axis is z, tilted by a third of a turn about (1, 1, 1) or about (-1, -1, -1): x or y.
    disc = GaussianCloud(
        means_m=np.array([[0.9, 0.8, 2.0]], dtype=np.float32),
        quats_wxyz=np.array([[0.5, 0.5 * turn, 0.5 * turn, 0.5 * turn]], dtype=np.float32),
        scales_m=np.array([[0.5, 0.4, 0.01]], dtype=np.float32),
        opacities=np.array([0.9], dtype=np.float32),
        sh=np.zeros((1, 1, 3), dtype=np.float32),
    )
    K = np.array([[40.0, 0.0, 40.0], [0.0, 40.0, 30.0], [0.0, 0.0, 1.0]])
    normal = images_of(rasterizer([disc], [], K), np.eye(4), (), ("normal",)).normal
    expected = (-1.0, 0.0, 0.0) if turn > 0 else (0.0, -1.0, 0.0)
    assert normal[normal.any(axis=2)] == pytest.approx(np.tile(expected, (int(normal.any(axis=2).sum()), 1)), abs=1e-4)
    assert normal.any()


def test_odd_image_size_is_written_in_full(make_cloud, camera) -> None:
    T, K = camera(-4.0, 0.0, 0.0, 37, 21)
    cloud = make_cloud(1500)
    images = images_of(CpuRasterizer(pack_cloud(cloud), {}, K, 21, 37), T, (), ("depth", "median_depth", "alpha"))
    expected = rasterize_reference(cloud, T, K, 21, 37)
    assert (~np.isclose(images.depth_m, expected.depth_m, rtol=3e-4)).mean() < 0.01
    assert (~np.isclose(images.median_depth_m, expected.median_depth_m, rtol=1e-5)).mean() < 0.01


@pytest.mark.parametrize("outputs", [("depth", "dept"), "depth"])
def test_unknown_output_is_refused_in_one_line(make_cloud, camera, outputs: Sequence[str]) -> None:
    T, K = camera(0.0, 0.0, 0.0, WIDTH, HEIGHT)
    with pytest.raises(ValueError, match=r"outputs must be names out of rgb, depth, .* got .*dept") as error:
        images_of(rasterizer([make_cloud(10)], [], K), T, (), outputs)
    assert "\n" not in str(error.value)


def test_normals_of_a_scene_that_was_packed_without_are_refused(make_cloud, camera) -> None:
    T, K = camera(0.0, 0.0, 0.0, WIDTH, HEIGHT)
    draws = CpuRasterizer(pack_cloud(make_cloud(10)), {}, K, HEIGHT, WIDTH)
    with pytest.raises(ValueError, match="normals=True"):
        images_of(draws, T, (), ("normal",))


def test_more_humans_than_a_mask_can_number_are_refused(make_cloud, camera, avatar: Avatar) -> None:
    T, K = camera(0.0, 0.0, 0.0, WIDTH, HEIGHT)
    draws = rasterizer([make_cloud(10)], [avatar], K)
    with pytest.raises(ValueError, match="255 humans"):
        images_of(draws, T, [human(9.0, 0.0)] * 256, ("mask",))
