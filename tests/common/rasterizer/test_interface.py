"""What every backend does alike."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.errors import AvatarError, ReadygoError
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.irradiance import irradiance_matrix
from readygo.common.images.images import Images
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman, Rasterizer, View, render_each
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.rasterizer.reference import ReferenceRasterizer
from readygo.common.robot import CameraConfig

CAMERA = CameraConfig(height_px=24, width_px=40)
OTHERS = ("depth", "alpha", "normal")
"""Images besides rgb that every backend makes."""
Make = Callable[[GaussianCloud, Avatar], Rasterizer]


def _make_cpu(cloud: GaussianCloud, avatar: Avatar) -> Rasterizer:
    pack = pack_cloud(cloud, normals=True)
    return CpuRasterizer(pack, {"ada": avatar}, CAMERA.K_px, CAMERA.height_px, CAMERA.width_px)


def _make_reference(cloud: GaussianCloud, avatar: Avatar) -> Rasterizer:
    return ReferenceRasterizer([cloud], {"ada": avatar}, CAMERA)


@pytest.fixture(params=["cpu", "reference", "gsplat", "triton"])
def make(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Makes a rasterizer of a cloud and the avatar "ada"; the GPU's run here by what stands in for a GPU."""
    if request.param in ("cpu", "reference"):
        return {"cpu": _make_cpu, "reference": _make_reference}[request.param]
    pytest.importorskip("torch", reason="torch is not installed")
    device = request.getfixturevalue("triton_device") if request.param == "triton" else "cpu"
    from readygo.common.rasterizer.gpu.rasterizer import GpuRasterizer
    from tests.common.rasterizer.gpu.reference_rasterization import stand_in_for_gsplat

    if request.param == "gsplat":
        stand_in_for_gsplat(monkeypatch)
    size = CAMERA.height_px, CAMERA.width_px

    def make_gpu(cloud: GaussianCloud, avatar: Avatar) -> Rasterizer:
        return GpuRasterizer(cloud, {"ada": avatar}, CAMERA.K_px, *size, kernels=request.param, device=device)

    return make_gpu


@pytest.fixture(scope="module")
def cloud(make_cloud) -> GaussianCloud:
    return make_cloud(60, coefficients=4)


@pytest.fixture(scope="module")
def ada(avatar: Avatar) -> Avatar:
    """A few of the avatar's Gaussians."""
    index = np.arange(0, len(avatar.cloud), 20)
    return replace(
        avatar, cloud=avatar.cloud.select(index), lbs_index=avatar.lbs_index[index], lbs_weight=avatar.lbs_weight[index]
    )


def human(x_m: float = 0.0, *, avatar: str = "ada", seed: int = 1) -> PosedHuman:
    pose = 0.4 * np.random.default_rng(seed).normal(size=(24, 3))
    return PosedHuman(avatar=avatar, root_m=np.array([x_m, 0.0, 1.0]), pose_axis_angle=pose)


def view(x_m: float = -5.0, humans: Sequence[PosedHuman] = ()) -> View:
    return View(T_world_camera=CAMERA.T_world_camera(x_m, 0.0, 0.1, 0.8), humans=humans)


VIEWS = (view(), view(-4.0, (human(),)), view(-4.0, (human(), human(1.0, seed=2))), view(-5.0))


def test_batch_holds_the_images_of_its_views(make: Make, cloud: GaussianCloud, ada: Avatar) -> None:
    rasterizer = make(cloud, ada)
    batch = rasterizer.render(VIEWS, ("rgb", *OTHERS))
    assert batch.rgb.shape == (4, 24, 40, 3)
    assert batch.rgb.dtype == np.uint8
    assert len({batch.rgb[k].tobytes() for k in range(3)}) == 3
    assert np.array_equal(batch.rgb[0], batch.rgb[3])
    for number, one in enumerate(VIEWS):
        alone = rasterizer.render([one], OTHERS)[0]
        assert alone.arrays().keys() == {"rgb", "depth_m", "alpha", "normal"}
        for name, array in alone.arrays().items():
            assert np.array_equal(array, batch[number].arrays()[name]), name
    assert rasterizer.render(VIEWS[:1]).arrays().keys() == {"rgb"}


def test_images_are_those_of_the_reference(make: Make, cloud: GaussianCloud, ada: Avatar) -> None:
    images = make(cloud, ada).render(VIEWS, OTHERS)
    expected = _make_reference(cloud, ada).render(VIEWS, OTHERS)
    assert np.abs(images.rgb.astype(int) - expected.rgb).mean() < 0.1
    assert np.abs(images.alpha - expected.alpha).mean() < 1e-3
    assert np.isclose(images.depth_m, expected.depth_m, rtol=1e-3).mean() > 0.99


def test_humans_are_lit_as_in_the_reference(make: Make, cloud: GaussianCloud, ada: Avatar) -> None:
    warm, cold = (irradiance_matrix(np.random.default_rng(seed).normal(2.0, 1.0, size=(9, 3))) for seed in (0, 1))
    lit = (view(-4.0, (replace(human(), light=warm), human(1.0, seed=2))), view(-4.0, (replace(human(), light=cold),)))
    images, expected = make(cloud, ada).render(lit), _make_reference(cloud, ada).render(lit)
    assert np.abs(images.rgb.astype(int) - expected.rgb).mean() < 0.1
    unlit = make(cloud, ada).render([view(-4.0, (human(), human(1.0, seed=2)))])
    assert np.abs(images.rgb[0].astype(int) - unlit.rgb[0]).max() > 20


def test_feet_with_a_lead_are_before_what_is_nearer_or_refused(make: Make, ada: Avatar) -> None:
    pane = GaussianCloud(
        means_m=np.array([[-0.6, 0.0, 0.2]], dtype=np.float32),
        quats_wxyz=np.array([[1, 0, 0, 0]], dtype=np.float32),
        scales_m=np.array([[0.01, 2.0, 2.0]], dtype=np.float32),
        opacities=np.array([0.99], dtype=np.float32),
        sh=np.ones((1, 1, 3), dtype=np.float32),
    )
    rasterizer, upright = make(pane, ada), replace(human(), pose_axis_angle=np.zeros((24, 3)))
    before = replace(upright, lead_m=1.0, ground_m=0.5)
    if rasterizer.views_at_once > 1:
        with pytest.raises(ReadygoError, match="as their depths say"):
            rasterizer.render([view(-4.0, (before,))])
        return
    behind, images = (rasterizer.render([view(-4.0, (one,))], ("depth",))[0] for one in (upright, before))
    rows, _ = np.nonzero(np.abs(images.rgb.astype(int) - behind.rgb).max(axis=2) > 8)
    assert len(rows)
    assert rows.min() > CAMERA.height_px / 2
    expected = _make_reference(pane, ada).render([view(-4.0, (before,))], ("depth",))[0]
    assert np.abs(images.rgb.astype(int) - expected.rgb).mean() < 0.1
    assert np.isclose(images.depth_m, expected.depth_m, rtol=1e-3).mean() > 0.99


def test_no_views_are_no_images(make: Make, cloud: GaussianCloud, ada: Avatar) -> None:
    images = make(cloud, ada).render([], ("depth",))
    assert images.rgb.shape == (0, 24, 40, 3)
    assert images.depth_m is not None
    assert images.depth_m.shape == (0, 24, 40)


@pytest.mark.parametrize("pose", [np.full((4, 4), np.nan), np.eye(3), np.eye(4)[None]])
def test_bad_camera_pose_is_refused(make: Make, cloud: GaussianCloud, ada: Avatar, pose: np.ndarray) -> None:
    with pytest.raises(ValueError, match="T_world_camera must be a finite 4x4 matrix"):
        make(cloud, ada).render([VIEWS[0], View(T_world_camera=pose)])


@pytest.mark.parametrize("outputs", [("rgb", "colour"), "depth"])
def test_unknown_output_is_refused(make: Make, cloud: GaussianCloud, ada: Avatar, outputs: Sequence[str]) -> None:
    with pytest.raises(ValueError, match="outputs must be names out of rgb, depth, "):
        make(cloud, ada).render(VIEWS, outputs)


def test_unknown_avatar_is_refused(make: Make, cloud: GaussianCloud, ada: Avatar) -> None:
    with pytest.raises(AvatarError, match="Avatar 'eve' is not loaded"):
        make(cloud, ada).render([view(humans=(human(avatar="eve"),))])


@pytest.mark.parametrize(
    "change",
    [{"root_m": np.array([np.nan, 0.0, 0.0])}, {"root_m": np.zeros(2)}, {"pose_axis_angle": np.full((24, 3), np.inf)}],
)
def test_human_who_is_nowhere_is_refused(make: Make, cloud: GaussianCloud, ada: Avatar, change: dict) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(change))} of a human must be finite, of shape"):
        make(cloud, ada).render([view(humans=(replace(human(), **change),))])


def test_more_humans_than_a_mask_can_tell_apart_are_refused(make: Make, cloud: GaussianCloud, ada: Avatar) -> None:
    with pytest.raises(ValueError, match="a mask can tell 255 humans apart, got 256"):
        make(cloud, ada).render([view(humans=[human()] * 256)], ("mask",))


def test_shadows_are_in_colours_only_or_refused(make: Make, cloud: GaussianCloud, ada: Avatar, make_cloud) -> None:
    rasterizer, plain = make(cloud, ada), view(-4.0, (human(),))
    shadowed = replace(plain, shadows=make_cloud(20, seed=3, low=(-2.0, -1.0, 0.0), high=(0.0, 1.0, 2.0)))
    if rasterizer.views_at_once > 1:
        with pytest.raises(ReadygoError, match="draw no shadows"):
            rasterizer.render([shadowed])
        return
    one, two = rasterizer.render([plain, shadowed], OTHERS)[0], rasterizer.render([plain, shadowed], OTHERS)[1]
    assert not np.array_equal(one.rgb, two.rgb)
    assert np.array_equal(two.rgb, rasterizer.render([shadowed])[0].rgb)
    for name in ("depth_m", "alpha", "normal"):
        assert np.array_equal(one.arrays()[name], two.arrays()[name])


class Numbers:
    """A rasterizer whose images show the camera's place."""

    def __init__(self, views_at_once: int) -> None:
        self.views_at_once, self.batches = views_at_once, []

    def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
        self.batches.append((len(views), tuple(outputs)))
        rgb = np.array([one.T_world_camera[0, 3] for one in views]).astype(np.uint8)
        return Images(rgb=rgb.reshape(-1, 1, 1, 1), mask=rgb.reshape(-1, 1, 1) if "mask" in outputs else None)


def test_views_are_drawn_in_batches_of_equal_outputs_and_come_back_in_order() -> None:
    rasterizer = Numbers(4)
    wanted = [(view(float(k)), ("mask",) if k in (2, 5) else ("rgb",)) for k in range(6)]
    images = list(render_each(rasterizer, iter(wanted)))
    assert [int(one.rgb[0, 0, 0]) for one in images] == list(range(6))
    assert [one.mask is not None for one in images] == [k in (2, 5) for k in range(6)]
    assert rasterizer.batches == [(3, ("rgb",)), (1, ("mask",)), (1, ("rgb",)), (1, ("mask",))]


def test_views_are_taken_only_when_they_are_drawn() -> None:
    asked = []

    def views():
        for k in range(5):
            asked.append(k)
            yield view(float(k)), ("rgb",)

    next(render_each(Numbers(1), views()))
    assert asked == [0]
