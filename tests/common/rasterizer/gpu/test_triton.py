import numpy as np
import numpy.typing as npt
import pytest

from readygo.common.gaussians import GaussianCloud, concatenate, transform_cloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.rasterizer.reference import rasterize_reference
from tests.common.rasterizer.drawing import batch_of, float_rgb_of, images_of, numbered, rgb_of

HEIGHT, WIDTH = 48, 64


@pytest.fixture(scope="module")
def rasterizer(triton_device: str):
    """Makes rasterizers with settings that suit the interpreter: few tiles, few slabs, short runs."""
    from readygo.common.rasterizer.gpu.rasterizer import GpuRasterizer
    from readygo.common.rasterizer.gpu.triton.settings import TritonSettings

    def make(scenes, avatars, K, height: int = HEIGHT, width: int = WIDTH, **settings):
        chosen = {
            "tile_height_px": 16,
            "slab_shares": (0.4,),
            "sort_run": 64,
            "long_sort_run": 64,
            "programs_per_processor": 1,
            **settings,
        }
        return GpuRasterizer(
            scenes,
            numbered(avatars),
            K,
            height,
            width,
            kernels="triton",
            device=triton_device,
            settings=TritonSettings(**chosen),
        )

    return make


def with_arrays(cloud: GaussianCloud, **arrays: npt.NDArray[np.float32]) -> GaussianCloud:
    names = ("means_m", "quats_wxyz", "scales_m", "opacities", "sh")
    return GaussianCloud(**{name: arrays.get(name, getattr(cloud, name)) for name in names})


def assert_like_reference(image: npt.NDArray[np.floating], reference: npt.NDArray[np.floating]) -> None:
    assert reference.max() > 0.1
    assert np.abs(image - reference).max() < 2 / 255
    assert np.abs(image - reference).mean() < 1e-4


def test_two_cameras_with_their_own_humans_look_as_in_the_reference(
    make_cloud, camera, small_avatar, human, posed, rasterizer
) -> None:
    near, sky = make_cloud(120, coefficients=4), make_cloud(30, low=(30, -20, -5), high=(50, 20, 25), scale_m=3.0)
    humans = [[human(-2.8, 0.4), human(-2.0, -0.5, seed=2)], [human(-3.0, 0.0, seed=3)]]
    poses = np.stack([camera(-4.5, 0.2, 0.1, WIDTH, HEIGHT)[0], camera(-5.0, -0.6, 0.0, WIDTH, HEIGHT)[0]])
    K = camera(0, 0, 0, WIDTH, HEIGHT)[1]
    images = rasterizer([near, sky], [small_avatar], K).render(batch_of(poses, humans)).rgb
    for k in range(2):
        cloud = concatenate([posed(near, [small_avatar], humans[k]), sky])
        reference = rasterize_reference(cloud, poses[k], K, HEIGHT, WIDTH).rgb
        assert reference.max() > 0.3
        assert np.abs(images[k] - 255 * np.clip(reference, 0, 1)).max() < 2


@pytest.mark.parametrize("coefficients", [9, 16])
def test_higher_harmonics_look_as_in_the_reference(make_cloud, camera, rasterizer, coefficients: int) -> None:
    cloud = make_cloud(90, coefficients=coefficients)
    T, K = camera(-4.0, 0.5, 0.2, 32, 24)
    image = float_rgb_of(rasterizer(cloud, [], K, 24, 32), T)
    assert_like_reference(image, rasterize_reference(cloud, T, K, 24, 32).rgb)


def test_gaussians_around_the_camera_look_as_in_the_reference(make_cloud, camera, rasterizer) -> None:
    cloud = make_cloud(200, low=(-0.6, -0.6, 0.6), high=(0.6, 0.6, 1.8), scale_m=0.03)
    for yaw in (0.0, 2.6):
        T, K = camera(0.0, 0.0, yaw, 37, 29)
        image = float_rgb_of(rasterizer(cloud, [], K, 29, 37), T)
        assert_like_reference(image, rasterize_reference(cloud, T, K, 29, 37).rgb)


def test_scene_far_from_the_origin_is_as_sharp(make_cloud, camera, rasterizer) -> None:
    shift = (900.0, -1400.0, 0.0)
    cloud = transform_cloud(make_cloud(80), np.eye(3), shift)
    T, K = camera(-4.0 + shift[0], shift[1], 0.0, 32, 24)
    assert_like_reference(
        float_rgb_of(rasterizer(cloud, [], K, 24, 32), T), rasterize_reference(cloud, T, K, 24, 32).rgb
    )


def test_all_images_are_those_of_the_gaussians(make_cloud, camera, small_avatar, human, posed, rasterizer) -> None:
    scene = with_arrays(make_cloud(40, scale_m=0.15), opacities=np.full(40, 0.7, dtype=np.float32))
    body = small_avatar.cloud.select(np.arange(60))
    thin = type(small_avatar)(
        **{name: getattr(small_avatar, name) for name in ("name", "license", "height_m", "joints_canonical_m")},
        cloud=with_arrays(body, scales_m=2 * body.scales_m, opacities=np.full(60, 0.9, dtype=np.float32)),
        lbs_index=small_avatar.lbs_index[:60],
        lbs_weight=small_avatar.lbs_weight[:60],
        joints_tpose_m=small_avatar.joints_tpose_m,
        R_tpose_canonical=small_avatar.R_tpose_canonical,
    )
    humans = [human(-2.9, 0.3), human(-2.4, -0.3, seed=2)]
    T, K = camera(-4.0, 0.0, 0.1, 32, 24)
    outputs = ("rgb", "depth", "median_depth", "alpha", "mask", "normal")
    images = images_of(rasterizer(scene, [thin], K, 24, 32), T, humans, outputs)
    cloud = posed(scene, [thin], humans)
    reference = rasterize_reference(cloud, T, K, 24, 32)
    np.testing.assert_allclose(images.alpha, reference.alpha, atol=2e-4)
    seen = reference.alpha > 0.01
    np.testing.assert_allclose(images.depth_m[seen], reference.depth_m[seen], rtol=1e-3)
    assert np.isinf(images.depth_m[reference.alpha == 0]).all()
    owners = np.repeat([0, 1, 2], [40, 60, 60])
    median_depth, mask = median_images(cloud, T, K, owners)
    alike = np.isclose(images.median_depth_m, median_depth, rtol=1e-4)
    assert alike.mean() > 0.99
    assert (images.mask[alike] == mask[alike]).all()
    assert {0, 1, 2} == set(np.unique(mask[np.isfinite(median_depth)]))
    solid = reference.alpha > 0.3
    dots = (images.normal * normal_image(cloud, T, K)).sum(axis=2)
    assert solid.sum() > 50
    assert dots[solid].min() > 0.999
    assert not images.normal[reference.alpha == 0].any()


def median_images(cloud: GaussianCloud, T, K, owners) -> tuple[np.ndarray, np.ndarray]:
    """Depth and owner of the Gaussian with which the picture of the nearest ones becomes half opaque."""
    depth = (cloud.means_m.astype(np.float64) - T[:3, 3]) @ T[:3, 2]
    median, mask = np.full((24, 32), np.inf), np.zeros((24, 32), dtype=np.uint8)
    order = np.argsort(depth)
    for count in range(1, len(order) + 1):
        alpha = rasterize_reference(cloud.select(order[:count]), T, K, 24, 32).alpha
        new = (alpha > 0.5) & np.isinf(median)
        median[new], mask[new] = depth[order[count - 1]], owners[order[count - 1]]
    return median, mask


def normal_image(cloud: GaussianCloud, T, K) -> np.ndarray:
    """Sums of normals, drawn as colours 0.5 + 0.5 n, at length 1."""
    from readygo.common.frames import matrix_from_quat

    axes = matrix_from_quat(cloud.quats_wxyz)[np.arange(len(cloud)), :, cloud.scales_m.argmin(axis=1)]
    normal, mean = axes @ T[:3, :3], (cloud.means_m - T[:3, 3]) @ T[:3, :3]
    normal = np.where((normal * mean).sum(axis=1, keepdims=True) > 0, -normal, normal)
    images = rasterize_reference(
        with_arrays(cloud, sh=(0.5 * normal / SH_C0)[:, None].astype(np.float32)), T, K, 24, 32
    )
    sums = 2.0 * images.rgb - images.alpha[..., None]
    return sums / np.maximum(np.linalg.norm(sums, axis=2, keepdims=True), 1e-9)


def test_batch_in_passes_has_the_bytes_of_single_images(make_cloud, camera, small_avatar, human, rasterizer) -> None:
    cloud, K = make_cloud(25), camera(0, 0, 0, 24, 16)[1]
    poses = np.stack([camera(-4.0, 0.5 * k, 0.1 * k, 24, 16)[0] for k in range(3)])
    humans = [[human(-1.5, 0.0)], [], [human(-1.5, 0.4, seed=2)]]
    batch = rasterizer(cloud, [small_avatar], K, 16, 24, cameras_per_pass=2)
    single = rasterizer(cloud, [small_avatar], K, 16, 24, programs_per_processor=3)
    images = batch.render(batch_of(poses, humans)).rgb
    assert images.shape == (3, 16, 24, 3)
    assert images.max() > 80
    for k in range(3):
        assert np.array_equal(images[k], rgb_of(single, poses[k], humans[k]))


def test_buffers_grow_until_everything_fits(make_cloud, camera, rasterizer) -> None:
    from readygo.common.rasterizer.gpu.triton.buffers import make_buffers

    T, K = camera(-4.0, 0.0, 0.0, 32, 24)
    roomy, tight = (rasterizer(make_cloud(280, scale_m=0.02), [], K, 24, 32, slab_shares=()) for _ in range(2))
    pipeline = tight._kernels._pipeline
    pipeline._buffers = make_buffers(1, 16, False, pipeline._device)
    assert np.array_equal(rgb_of(tight, T), rgb_of(roomy, T))
    assert pipeline._buffers.entry_capacity > 16
    assert pipeline.buffers_made >= 1


def test_what_stands_behind_finished_tiles_is_not_projected(make_cloud, camera, rasterizer) -> None:
    plates = make_cloud(8, low=(-2.0, 0.0, 1.0), high=(-1.9, 0.1, 1.1))
    wall = with_arrays(
        plates,
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (8, 1)),
        scales_m=np.tile(np.array([0.02, 4.0, 4.0], dtype=np.float32), (8, 1)),
        opacities=np.full(8, 0.95, dtype=np.float32),
    )
    behind = make_cloud(1000, low=(2.0, -4.0, -1.0), high=(9.0, 4.0, 4.0))
    T, K = camera(-4.0, 0.0, 0.0, 16, 16)
    culling = rasterizer([wall, behind], [], K, 16, 16, slab_shares=(0.3,))
    full = rasterizer([wall, behind], [], K, 16, 16, slab_shares=())
    assert np.abs(float_rgb_of(culling, T) - float_rgb_of(full, T)).max() < 1e-3
    pairs = [int(kernels._kernels._pipeline._needed[0]) for kernels in (culling, full)]
    assert pairs == [1, 5]


def test_a_far_sky_does_not_move_the_depth_of_finished_pixels(make_cloud, camera, rasterizer) -> None:
    """Half of the tile is a finished wall, so that the sky is blended on: at most 1e-4 of it could pass the wall."""
    wall = make_cloud(6, low=(-2.0, 2.0, 0.5), high=(-1.9, 2.0, 0.5))
    wall = with_arrays(
        wall,
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (6, 1)),
        scales_m=np.tile(np.array([0.02, 0.5, 9.0], dtype=np.float32), (6, 1)),
        opacities=np.full(6, 0.99, dtype=np.float32),
    )
    sky = make_cloud(40, low=(1800.0, -900.0, -900.0), high=(1800.0, 900.0, 900.0), scale_m=300.0)
    T, K = camera(-4.0, 0.0, 0.0, 16, 16)
    depth = images_of(rasterizer([wall, sky], [], K, 16, 16, slab_shares=()), T, [], ("depth",)).depth_m
    alone = images_of(rasterizer(wall, [], K, 16, 16), T, [], ("depth", "alpha"))
    finished = alone.alpha > 1 - 0.9e-4
    assert 10 < finished.sum() < 200
    assert np.abs(depth - alone.depth_m)[finished].max() < 0.005
    assert depth[~finished].max() > 1000


def test_equal_depths_are_drawn_in_the_order_of_the_scene(make_cloud, camera, rasterizer) -> None:
    cloud = make_cloud(40, low=(0.0, -0.5, 0.8), high=(0.0, 0.5, 1.6), scale_m=0.3)
    cloud = with_arrays(cloud, means_m=np.round(cloud.means_m * 4) / np.float32(4))
    T, K = camera(-2.0, 0.0, 0.0, 32, 24, 0.0)
    images = [float_rgb_of(rasterizer(cloud, [], K, 24, 32, programs_per_processor=n), T) for n in (1, 2)]
    assert images[0].max() > 0.3
    assert np.array_equal(*images)


@pytest.mark.parametrize("run", [2, 16])
def test_lists_of_any_length_are_sorted(triton_device: str, run: int) -> None:
    import torch

    from readygo.common.rasterizer.gpu.triton.tiles import sort_lists

    lengths = [0, 1, 2, 5, 16, 17, 70]
    rng = np.random.default_rng(0)
    keys = rng.permutation(sum(lengths)).astype(np.int64) << 32
    starts, counts = np.cumsum([0, *lengths[:-1]]), np.array(lengths, dtype=np.int32)
    entries, spare = (
        torch.tensor(keys, device=triton_device),
        torch.zeros(len(keys), dtype=torch.int64, device=triton_device),
    )
    flags = torch.zeros(len(lengths), dtype=torch.int32, device=triton_device)
    tensors = [torch.tensor(array, device=triton_device) for array in (starts, counts)]
    for least, most in ((2, 16), (17, 1000)):
        sort_lists[(len(lengths),)](entries, spare, *tensors, len(keys), flags, least, most, RUN=run)
    for start, length, flag in zip(starts, lengths, flags.tolist(), strict=True):
        found = (spare if flag else entries)[start : start + length].cpu().numpy()
        assert np.array_equal(found, np.sort(keys[start : start + length]))


def test_empty_scene_is_black(make_cloud, camera, rasterizer) -> None:
    T, K = camera(0.0, 0.0, 0.0, 40, 30)
    assert rgb_of(rasterizer(make_cloud(0), [], K, 30, 40), T).max() == 0
    behind = make_cloud(20, low=(-9, -1, 0), high=(-8, 1, 1))
    images = images_of(rasterizer(behind, [], K, 30, 40), T, outputs=("depth", "mask", "alpha"))
    assert np.isinf(images.depth_m).all()
    assert not images.alpha.any()


def test_gaussians_that_are_not_finite_do_not_reach_the_image(make_cloud, camera, rasterizer) -> None:
    cloud = make_cloud(60)
    means = cloud.means_m.copy()
    means[::7] = np.nan
    T, K = camera(-4.0, 0.0, 0.0, 32, 24)
    image = float_rgb_of(rasterizer(with_arrays(cloud, means_m=means), [], K, 24, 32), T)
    kept = cloud.select(np.isfinite(means).all(axis=1))
    assert_like_reference(image, rasterize_reference(kept, T, K, 24, 32).rgb)


def test_too_many_tiles_and_bad_requests_are_refused(make_cloud, camera, small_avatar, human, rasterizer) -> None:
    K = camera(0, 0, 0, 32, 24)[1]
    with pytest.raises(ValueError, match="limited to 255 tiles"):
        rasterizer(make_cloud(5), [], K, 4096, 4096, tile_width_px=8)
    small = rasterizer(make_cloud(5), [small_avatar], K, 24, 32)
    with pytest.raises(ValueError, match="outputs must be names"):
        images_of(small, np.eye(4), outputs=("colour",))
    with pytest.raises(ValueError, match="255 humans"):
        images_of(small, np.eye(4), [human(0, 0)] * 256, ("mask",))
    with pytest.raises(ValueError, match="T_world_camera"):
        rgb_of(small, np.full((4, 4), np.nan))


@pytest.mark.parametrize(
    "bad", [{"tile_width_px": 12}, {"slab_shares": (0.5, 0.2)}, {"long_sort_run": 48}, {"cameras_per_pass": 0}]
)
def test_bad_settings_are_refused(bad: dict[str, object]) -> None:
    from readygo.common.rasterizer.gpu.triton.settings import TritonSettings

    with pytest.raises(ValueError, match=next(iter(bad))):
        TritonSettings(**bad)
