import dataclasses

import numpy as np
import pytest

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.images.images import OUTPUTS
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import View
from readygo.common.rasterizer.packed.scene import load_packed, pack_cloud, save_packed
from readygo.common.rasterizer.reference import posed_and_lit, rasterize_reference
from tests.common.rasterizer.cpu.frames_digest import frames, make_rasterizer, packed_scenes, view
from tests.common.rasterizer.drawing import (
    assert_like_reference,
    float_rgb_of,
    human,
    images_of,
    numbered,
    posed,
    psnr_db,
    rgb_of,
)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (37, 53), (256, 144), (333, 130)])
def test_any_image_size_looks_as_in_the_reference(make_cloud, camera, width: int, height: int) -> None:
    cloud = make_cloud(1500, scale_m=0.1)
    T, K = camera(-5.0, 0.0, 0.0, width, height)
    image = float_rgb_of(CpuRasterizer(pack_cloud(cloud), {}, K, height, width), T)
    reference = rasterize_reference(cloud, T, K, height, width).rgb
    assert image.shape == reference.shape
    assert psnr_db(image, reference) > 60


def test_large_image_with_large_gaussians_looks_as_in_the_reference(make_cloud, camera) -> None:
    cloud = concatenate([make_cloud(40, scale_m=0.3), make_cloud(300, scale_m=0.02)])
    T, K = camera(-4.0, 0.0, 0.1, 3840, 2160)
    image = float_rgb_of(CpuRasterizer(pack_cloud(cloud), {}, K, 2160, 3840), T)
    assert_like_reference(image, rasterize_reference(cloud, T, K, 2160, 3840).rgb)


def test_far_sky_is_drawn_behind_everything(make_cloud, camera) -> None:
    scene = make_cloud(800, low=(1.0, -3.0, 0.0), high=(5.0, 3.0, 2.0))
    ball = make_cloud(1500, low=(-1.0, -1.0, -1.0), high=(1.0, 1.0, 1.0))
    direction = ball.means_m / np.linalg.norm(ball.means_m, axis=1, keepdims=True)
    sky = GaussianCloud(
        means_m=direction * np.random.default_rng(4).uniform(330, 1800, (1500, 1)).astype(np.float32),
        quats_wxyz=ball.quats_wxyz,
        scales_m=ball.scales_m * 1000,
        opacities=ball.opacities,
        sh=ball.sh,
    )
    T, K = camera(0.0, 0.0, 0.0, 96, 64)
    image = float_rgb_of(CpuRasterizer([pack_cloud(scene), pack_cloud(sky)], {}, K, 64, 96), T)
    assert_like_reference(image, rasterize_reference(concatenate([scene, sky]), T, K, 64, 96).rgb)


def test_view_with_intrinsics_of_its_own_is_what_a_camera_of_these_draws(make_cloud, camera) -> None:
    cloud, wide = pack_cloud(make_cloud(900)), np.diag([0.6, 0.6, 1.0])
    T, K = camera(-5.0, 0.0, 0.0, 96, 64)
    K_wide = K.copy()
    K_wide[:2, :2] = (K @ wide)[:2, :2]
    rasterizer = CpuRasterizer(cloud, {}, K, 64, 96)
    views = [View(T_world_camera=T), View(T_world_camera=T, K_px=K_wide)]
    plain, other = rasterizer.render(views).rgb
    expected = CpuRasterizer(cloud, {}, K_wide, 64, 96).render(views[:1]).rgb[0]
    assert np.array_equal(other, expected)
    assert not np.array_equal(other, plain)


def test_two_layers_are_blended_as_one_cloud(make_cloud, camera) -> None:
    one, two = make_cloud(900, seed=1), make_cloud(900, seed=2, coefficients=9)
    T, K = camera(-5.0, 0.0, 0.0, 96, 64)
    image = float_rgb_of(CpuRasterizer([pack_cloud(one), pack_cloud(two)], {}, K, 64, 96), T)
    assert_like_reference(image, rasterize_reference(concatenate([one, two]), T, K, 64, 96).rgb)


def test_humans_are_lit_as_in_the_reference_and_even_light_changes_no_byte(make_cloud, camera, avatar: Avatar) -> None:
    T, K = camera(-4.0, 0.0, 0.0, 192, 128)
    # Red light from above, blue from the left; the rest is dim.
    light = np.zeros((3, 4, 4))
    light[:, 3, 3] = 0.6
    light[0, 2, 3] = light[0, 3, 2] = light[2, 1, 3] = light[2, 3, 1] = 0.25
    unlit, cloud = human(-2.6, 0.4, seed=1), make_cloud(200)
    lit = dataclasses.replace(unlit, light=light)
    rasterizer = CpuRasterizer(pack_cloud(cloud), numbered([avatar]), K, 128, 192)
    image = float_rgb_of(rasterizer, T, [lit])
    reference = rasterize_reference(concatenate([cloud, posed_and_lit(avatar, lit)]), T, K, 128, 192).rgb
    assert_like_reference(image, reference)
    assert np.abs(image - float_rgb_of(rasterizer, T, [unlit])).max() > 0.05
    even = np.zeros((3, 4, 4))
    even[:, 3, 3] = 1.0
    same = float_rgb_of(rasterizer, T, [dataclasses.replace(unlit, light=even)])
    assert np.array_equal(same, float_rgb_of(rasterizer, T, [unlit]))


def test_humans_stand_in_the_scene_as_in_the_reference(make_cloud, camera, avatar: Avatar) -> None:
    cloud = make_cloud(2000)
    humans = [human(-2.6, 0.4, seed=1), human(-1.8, -0.8, seed=2)]
    T, K = camera(-4.0, 0.0, 0.0, 192, 128)
    image = float_rgb_of(CpuRasterizer(pack_cloud(cloud), numbered([avatar]), K, 128, 192), T, humans)
    reference = rasterize_reference(posed(cloud, [avatar], humans), T, K, 128, 192).rgb
    assert_like_reference(image, reference)
    assert psnr_db(image, rasterize_reference(cloud, T, K, 128, 192).rgb) < 40


def test_image_does_not_depend_on_what_was_drawn_before(make_cloud, camera, avatar: Avatar) -> None:
    cloud = make_cloud(3000)
    views = [camera(-3.0 + k, 0.5 * k, 0.3 * k, 96, 64)[0] for k in range(4)]
    humans = [[human(-1.0, 0.0, avatar=k % 2, seed=k)] * (k % 3) for k in range(4)]
    K = camera(0, 0, 0, 96, 64)[1]
    used = CpuRasterizer(pack_cloud(cloud), numbered([avatar, avatar]), K, 64, 96)
    for k in (0, 1, 2, 3, 1, 0):
        fresh = CpuRasterizer(pack_cloud(cloud), numbered([avatar, avatar]), K, 64, 96)
        assert np.array_equal(rgb_of(used, views[k], humans[k]), rgb_of(fresh, views[k], humans[k]))


def test_bytes_are_the_rounded_and_clipped_floats(make_cloud, camera) -> None:
    cloud = make_cloud(3000)
    bright = GaussianCloud(
        means_m=cloud.means_m,
        quats_wxyz=cloud.quats_wxyz,
        scales_m=cloud.scales_m,
        opacities=cloud.opacities,
        sh=cloud.sh + np.float32(4.0),
    )
    T, K = camera(-4.0, 0.0, 0.0, 96, 64)
    rasterizer = CpuRasterizer(pack_cloud(bright), {}, K, 64, 96)
    floats = float_rgb_of(rasterizer, T)
    assert floats.max() > 1.05
    rounded = (np.clip(floats, 0, 1) * np.float32(255) + np.float32(0.5)).astype(np.uint8)
    assert np.array_equal(rgb_of(rasterizer, T), rounded)


def test_mapped_scene_gives_the_same_bytes(make_cloud, camera, tmp_path) -> None:
    scene = pack_cloud(make_cloud(2000, coefficients=4))
    save_packed(scene, tmp_path / "packed")
    mapped = load_packed(tmp_path / "packed")
    assert mapped is not None
    T, K = camera(-4.0, 0.0, 0.0, 96, 64)
    images = [rgb_of(CpuRasterizer(layer, {}, K, 64, 96), T) for layer in (scene, mapped)]
    assert np.array_equal(*images)


def test_empty_scene_is_black(make_cloud, camera) -> None:
    T, K = camera(0.0, 0.0, 0.0, 40, 30)
    assert rgb_of(CpuRasterizer(pack_cloud(make_cloud(0)), {}, K, 30, 40), T).max() == 0


@pytest.mark.parametrize("pose", [np.full((4, 4), np.nan), np.eye(3)])
def test_bad_camera_pose_is_refused(make_cloud, pose: Float64Array) -> None:
    rasterizer = CpuRasterizer(pack_cloud(make_cloud(10)), {}, np.eye(3) * 20, 16, 16)
    with pytest.raises(ValueError, match="T_world_camera"):
        rgb_of(rasterizer, pose)


def test_too_large_image_is_refused(make_cloud) -> None:
    with pytest.raises(ValueError, match="limited"):
        CpuRasterizer(pack_cloud(make_cloud(10)), {}, np.eye(3), 16, 300_000)


def test_frames_of_a_crooked_scene_are_as_they_were(golden_figures) -> None:
    """People in light and shade, near and far Gaussians of two degrees, each kind of image."""
    scenes = packed_scenes()
    for number, frame in enumerate(frames(scenes, range(3))):
        golden_figures(f"rasterizer/frame {number}", 3.0 * frame.reshape(-1, 3))
    images = images_of(make_rasterizer(scenes), *view(1), OUTPUTS)
    for field in dataclasses.fields(images):
        array = getattr(images, field.name)
        if array is not None:
            rows = np.nan_to_num(array.reshape(80 * 128, -1).astype(np.float64), posinf=99.0)
            golden_figures(f"rasterizer/{field.name}", rows / (64.0 if array.dtype == np.uint8 else 1.0))


def test_no_cloud_at_all_is_drawn_as_an_empty_one(make_cloud, camera) -> None:
    T, K = camera(0.0, 0.0, 0.0, 40, 24)
    images, empty = (
        images_of(CpuRasterizer(scenes, {}, K, 24, 40), T, (), OUTPUTS)
        for scenes in ([], pack_cloud(make_cloud(0), normals=True))
    )
    for name, array in images.arrays().items():
        assert np.array_equal(array, empty.arrays()[name]), name
    assert not images.rgb.any()
