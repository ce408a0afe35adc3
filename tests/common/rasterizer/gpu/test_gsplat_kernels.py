import importlib.util

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.errors import ReadygoError  # noqa: E402
from readygo.common.gaussians import GaussianCloud, transform_cloud  # noqa: E402
from readygo.common.gaussians.spherical_harmonics import SH_C0  # noqa: E402
from readygo.common.rasterizer.gpu.rasterizer import GpuRasterizer  # noqa: E402
from readygo.common.rasterizer.reference import rasterize_reference  # noqa: E402
from tests.common.rasterizer.drawing import batch_of, float_rgb_of, images_of, numbered, rgb_of  # noqa: E402
from tests.common.rasterizer.gpu.reference_rasterization import ReferenceRasterization, stand_in_for_gsplat  # noqa: E402

SIZE = 32, 48


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> ReferenceRasterization:
    """The calls that gsplat would have got."""
    return stand_in_for_gsplat(monkeypatch)


def gsplat(scenes, avatars, K, size=SIZE) -> GpuRasterizer:
    return GpuRasterizer(scenes, numbered(avatars), K, *size, kernels="gsplat", device="cpu")


def with_opacity(cloud: GaussianCloud, opacity: float) -> GaussianCloud:
    return GaussianCloud(
        means_m=cloud.means_m,
        quats_wxyz=cloud.quats_wxyz,
        scales_m=cloud.scales_m,
        opacities=np.full(len(cloud), opacity, dtype=np.float32),
        sh=cloud.sh,
    )


def test_scene_and_humans_reach_gsplat_in_its_conventions(make_cloud, camera, avatar, human, posed, drawn) -> None:
    cloud, sky = make_cloud(300, coefficients=4), make_cloud(50, seed=3)
    humans = [human(-2.6, 0.4), human(-2.0, -0.5, seed=2)]
    T, K = camera(-4.0, 0.2, 0.1, 48, 32)
    image = float_rgb_of(gsplat([cloud, sky], [avatar], K), T, humans)
    both = posed(cloud, [avatar], humans)
    wide = np.zeros((len(sky), 4, 3), dtype=np.float32)
    wide[:, :1] = sky.sh
    assert drawn.calls[0]["sh_degree"] == 1
    assert len(drawn.calls[0]["means"]) > len(cloud)
    reference = rasterize_reference(joined(both, sky), T, K, *SIZE).rgb
    assert reference.max() > 0.3
    assert np.abs(image - reference).max() < 0.02
    assert np.abs(image - reference).mean() < 1e-4


def joined(one: GaussianCloud, two: GaussianCloud) -> GaussianCloud:
    from readygo.common.gaussians import concatenate

    return concatenate([one, two])


def test_rules_of_the_rasterizer_are_asked_for(make_cloud, camera, drawn) -> None:
    T, K = camera(-4.0, 0.0, 0.0, 48, 32)
    rgb_of(gsplat(with_opacity(make_cloud(20), 1.0), [], K), T)
    call = drawn.calls[0]
    wanted = {"near_plane": 0.05, "eps2d": 0.3, "tile_size": 16, "packed": True, "width": 48, "height": 32}
    assert {name: call[name] for name in wanted} == wanted
    assert call["far_plane"] > 2000
    assert call["opacities"].max() == np.float32(0.99)


def test_scene_far_from_the_origin_is_as_sharp(make_cloud, camera, avatar, human, drawn) -> None:
    shift = (9000.0, -14000.0, 0.0)
    cloud = with_opacity(make_cloud(300), 0.8)
    far = transform_cloud(cloud, np.eye(3), shift)
    near = GaussianCloud(
        means_m=(far.means_m.astype(np.float64) - shift).astype(np.float32),
        quats_wxyz=far.quats_wxyz,
        scales_m=far.scales_m,
        opacities=far.opacities,
        sh=far.sh,
    )
    T, K = camera(-4.0, 0.0, 0.0, 48, 32)
    T_far = T.copy()
    T_far[:3, 3] += shift
    image = float_rgb_of(gsplat(far, [avatar], K), T_far, [human(-2.0 + shift[0], shift[1])])
    assert np.abs(image - float_rgb_of(gsplat(near, [avatar], K), T, [human(-2.0, 0.0)])).max() < 1e-3


def test_cameras_that_see_the_same_humans_share_a_call(make_cloud, camera, avatar, human, drawn) -> None:
    poses = np.stack([camera(-4.0, 0.3 * k, 0.0, 48, 32)[0] for k in range(4)])
    K = camera(0, 0, 0, 48, 32)[1]
    one, other = [human(-2.0, 0.0)], [human(-2.0, 0.5)]
    kernels = gsplat(make_cloud(60), [avatar], K)
    images = kernels.render(batch_of(poses, [one, one, other, []])).rgb
    assert [len(call["viewmats"]) for call in drawn.calls] == [2, 1, 1]
    for k, humans in enumerate((one, one, other, [])):
        assert np.array_equal(images[k], rgb_of(kernels, poses[k], humans))


def test_depth_alpha_and_normals_are_made(make_cloud, camera, drawn) -> None:
    cloud = with_opacity(make_cloud(200), 0.9)
    T, K = camera(-4.0, 0.2, 0.1, 48, 32)
    images = images_of(gsplat(cloud, [], K), T, outputs=("depth", "alpha", "normal"))
    reference = rasterize_reference(cloud, T, K, *SIZE)
    assert images.normal is not None
    seen = reference.alpha > 0.1
    np.testing.assert_allclose(images.depth_m[seen], reference.depth_m[seen], rtol=1e-3)
    np.testing.assert_allclose(images.alpha, reference.alpha, atol=1e-3)
    assert np.isinf(images.depth_m[images.alpha == 0]).all()


def test_normals_look_towards_each_camera(make_cloud, camera, drawn) -> None:
    wall = make_cloud(400, low=(0.0, -3.0, -1.0), high=(0.1, 3.0, 3.0), scale_m=0.4)
    flat = GaussianCloud(
        means_m=wall.means_m,
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (len(wall), 1)),
        scales_m=np.tile(np.array([0.01, 0.4, 0.4], dtype=np.float32), (len(wall), 1)),
        opacities=wall.opacities,
        sh=wall.sh,
    )
    kernels = gsplat(flat, [], camera(0, 0, 0, 48, 32)[1])
    for x, yaw in ((-4.0, 0.0), (4.0, np.pi)):
        images_of(kernels, camera(x, 0.0, yaw, 48, 32, 0.0)[0], outputs=("normal",))
        np.testing.assert_allclose(
            drawn.calls[-1]["colors"][0], [[0.0, 0.0, -1.0]] * len(drawn.calls[-1]["means"]), atol=1e-6
        )


@pytest.mark.parametrize("name", ["mask", "median_depth"])
def test_images_that_gsplat_cannot_make_are_refused(make_cloud, camera, drawn, name: str) -> None:
    T, K = camera(-4.0, 0.0, 0.0, 48, 32)
    with pytest.raises(ReadygoError, match=f"not {name}; use triton"):
        images_of(gsplat(make_cloud(20), [], K), T, outputs=("rgb", name))


def test_projection_of_gsplats_torch_reference_is_ours(make_cloud, camera, drawn) -> None:
    if importlib.util.find_spec("gsplat") is None:
        pytest.skip("gsplat is not installed (the extra `gpu`)")
    from gsplat.cuda._torch_impl import _fully_fused_projection, _quat_scale_to_covar_preci

    cloud = with_opacity(make_cloud(300, low=(-2, -2, 0), high=(2, 2, 2)), 0.7)
    T, K = camera(-1.0, 0.0, 0.0, 48, 32)
    image = float_rgb_of(gsplat(cloud, [], K), T)
    call = drawn.calls[0]
    covars, _ = _quat_scale_to_covar_preci(call["quats"], call["scales"], compute_preci=False)
    radii, means2d, depths, conics, _ = _fully_fused_projection(
        call["means"], covars, call["viewmats"], call["Ks"], 48, 32, eps2d=call["eps2d"], near_plane=call["near_plane"]
    )
    rgb = (0.5 + SH_C0 * call["colors"][:, 0]).clamp(min=0)
    blended = blend_as_gsplat(radii[0], means2d[0], depths[0], conics[0], call["opacities"], rgb)
    assert image.max() > 0.3
    assert np.abs(blended - image).max() < 0.011


def blend_as_gsplat(radii, means2d, depths, conics, opacities, rgb) -> np.ndarray:
    """Pixels by the rules of gsplat's RasterizeToPixels3DGSFwd.cu."""
    height, width = SIZE
    v, u = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    image, light = torch.zeros(height, width, 3), torch.ones(height, width)
    done = torch.zeros(height, width, dtype=torch.bool)
    for n in torch.argsort(depths).tolist():
        if not (radii[n] > 0).all():
            continue
        dx, dy = means2d[n, 0] - u, means2d[n, 1] - v
        sigma = 0.5 * (conics[n, 0] * dx * dx + conics[n, 2] * dy * dy) + conics[n, 1] * dx * dy
        alpha = (opacities[n] * torch.exp(-sigma)).clamp(max=0.999)
        due = ~done & (sigma >= 0) & (alpha >= 1 / 255)
        after = light * (1 - alpha)
        done |= due & (after <= 1e-4)
        due &= ~done
        image += torch.where(due, alpha * light, torch.zeros(()))[..., None] * rgb[n]
        light = torch.where(due, after, light)
    return image.numpy()
