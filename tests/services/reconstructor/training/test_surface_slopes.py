"""Losses of surfaces and their derivatives against what torch derives in float64."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from readygo.services.reconstructor.training.config import GeometryConfig
from readygo.services.reconstructor.training.neighbours import Side
from readygo.services.reconstructor.training.photos import Photo
from readygo.services.reconstructor.training.planes import rays_of
from readygo.services.reconstructor.training.surface_slopes import PlaneView, surface_slopes
from readygo.services.reconstructor.training.surfaces import GREY, between, normals_within, off_measured

SIZE_PX = (30, 40)
K = np.array([[50.0, 0.0, 20.5], [0.0, 48.0, 15.0], [0.0, 0.0, 1.0]])
NORMAL = np.array([0.2, 0.1, -np.sqrt(0.95)])
NORMALS = GeometryConfig(enabled=True, normal=2.0, consistent=0.0, ncc=0.0, noise_px=3.0)
RETURNS = replace(NORMALS, normal=0.0, consistent=1.0)
PATCHES = replace(NORMALS, normal=0.0, ncc=1.0)
ALL = GeometryConfig(enabled=True, noise_px=3.0, patches_max=150)


def photo(x_m: float, yaw_rad: float) -> Photo:
    T = np.eye(4)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    T[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    T[0, 3] = x_m
    v, u = np.mgrid[:30, :40]
    waves = [0.5 + 0.3 * np.sin(0.4 * u + 0.3 * v + 2.0 * x_m + k) + 0.1 * np.cos(0.7 * v - k) for k in range(3)]
    return Photo(rgb=np.array(waves, dtype=np.float32), K_px=K, T_world_camera=T)


def planes(view: Photo, seed: int) -> np.ndarray:
    """A bumpy wall 3 m away, with holes, blended with some opacity."""
    rng, T = np.random.default_rng(seed), view.T_world_camera
    distance = 3.0 + NORMAL @ T[:3, 3] + 0.01 * rng.normal(size=SIZE_PX)
    normals = NORMAL[:, None, None] + 0.03 * rng.normal(size=(3, *SIZE_PX))
    blended = np.concatenate([normals, distance[None]]) * rng.uniform(0.6, 1.0, SIZE_PX)
    blended[:, 12:15, 20:24] = 0.0
    return blended.astype(np.float32)


def views() -> tuple[PlaneView, PlaneView]:
    one, other = photo(0.0, 0.0), photo(0.3, -0.08)
    return PlaneView(photo=one, planes=planes(one, 0)), PlaneView(photo=other, planes=planes(other, 1))


def alpha() -> np.ndarray:
    return np.random.default_rng(2).uniform(0.6, 1.0, SIZE_PX).astype(np.float32)


def side_in_float64(view: PlaneView) -> Side:
    T = torch.tensor(view.photo.T_world_camera)
    return Side(
        planes=torch.tensor(view.planes.astype(np.float64)).permute(1, 2, 0).requires_grad_(),
        grey=torch.tensordot(torch.tensor(GREY, dtype=torch.float64), torch.tensor(view.photo.rgb).double(), 1),
        K_px=torch.tensor(K),
        T_world_camera=T,
        rays_W=rays_of(K, SIZE_PX, dtype=torch.float64) @ T[:3, :3].T,
        mask=None if view.photo.mask is None else torch.tensor(view.photo.mask),
    )


def masked(view: PlaneView, rows: slice, columns: slice) -> PlaneView:
    """The view with a part of its photo that is ignored."""
    mask = np.ones(SIZE_PX, np.bool_)
    mask[rows, columns] = False
    return replace(view, photo=replace(view.photo, mask=mask))


@pytest.mark.parametrize("masks", [False, True])
@pytest.mark.parametrize("config", [NORMALS, RETURNS, PATCHES, ALL], ids=["normals", "returns", "patches", "all"])
def test_loss_and_slopes_are_those_that_torch_derives(config: GeometryConfig, masks: bool) -> None:
    one, other = views()
    if masks:
        one, other = masked(one, slice(4, 17), slice(9, 22)), masked(other, slice(10, 25), slice(15, 30))
    here, there = side_in_float64(one), side_in_float64(other)
    rgb = torch.tensor(one.photo.rgb).double()
    wanted = normals_within(here, torch.tensor(alpha()).double(), rgb, config)
    wanted = wanted + between(here, there, config, np.random.default_rng(3))
    wanted.backward()
    loss, by_one, by_other = surface_slopes(one, other, alpha(), config, np.random.default_rng(3))
    assert loss == pytest.approx(float(wanted.detach()), rel=1e-5)
    assert loss > 1e-3
    assert by_other is not None
    for found, tensor in ((by_one, here.planes), (by_other, there.planes)):
        assert tensor.grad is not None
        exact = tensor.grad.permute(2, 0, 1).numpy()
        np.testing.assert_allclose(found, exact, atol=1e-5 * max(float(np.abs(exact).max()), 1e-9))
    assert np.abs(by_one).max() > 0.0
    assert (np.abs(by_other).max() > 0.0) == (config.consistent > 0.0)


def test_view_without_neighbour_has_the_loss_of_normals() -> None:
    one, other = views()
    alone, slopes, none = surface_slopes(one, None, alpha(), ALL, np.random.default_rng(0))
    assert none is None
    normals = replace(ALL, consistent=0.0, ncc=0.0)
    both, by_one, by_other = surface_slopes(one, other, alpha(), normals, np.random.default_rng(0))
    assert alone == pytest.approx(both)
    np.testing.assert_allclose(slopes, by_one, atol=1e-9)
    assert by_other is not None
    assert not by_other.any()


def test_views_that_see_nothing_of_each_other_say_nothing() -> None:
    one, other = views()
    turned = replace(other.photo, T_world_camera=photo(0.3, np.pi).T_world_camera)
    alone, slopes, _ = surface_slopes(one, None, alpha(), ALL, np.random.default_rng(0))
    found, by_one, by_other = surface_slopes(
        one, PlaneView(photo=turned, planes=other.planes), alpha(), ALL, np.random.default_rng(0)
    )
    assert found == alone
    np.testing.assert_array_equal(by_one, slopes)
    assert by_other is not None
    assert not by_other.any()


def test_ignored_pixels_have_no_part_in_the_losses() -> None:
    one, other = views()
    one = masked(one, slice(0, 30), slice(0, 25))
    _, by_one, _ = surface_slopes(one, None, alpha(), NORMALS, np.random.default_rng(3))
    assert not by_one[:, :, :23].any()
    assert by_one[:, 5:25, 27:35].any()
    nothing = masked(other, slice(0, 30), slice(0, 40))
    loss, _, by_other = surface_slopes(views()[0], nothing, alpha(), RETURNS, np.random.default_rng(3))
    assert loss == 0.0
    assert by_other is not None
    assert not by_other.any()


MEASURED = replace(NORMALS, normal=0.0, depth=1.0)


def with_depths(view: PlaneView) -> PlaneView:
    """The view with measured depths of about 3 m, and a quarter that was not measured."""
    depth_m = np.random.default_rng(4).uniform(2.0, 4.0, SIZE_PX).astype(np.float32)
    depth_m[:15, :20] = 0.0
    return replace(view, photo=replace(view.photo, depth_m=depth_m))


@pytest.mark.parametrize("masks", [False, True])
def test_loss_of_measured_depths_is_that_which_torch_derives(masks: bool) -> None:
    one = with_depths(views()[0])
    if masks:
        one = masked(one, slice(4, 27), slice(9, 32))
    here = side_in_float64(one)
    wanted = off_measured(here, torch.tensor(one.photo.depth_m).double(), MEASURED)
    wanted.backward()
    loss, by_planes, _ = surface_slopes(one, None, alpha(), MEASURED, np.random.default_rng(0))
    assert loss == pytest.approx(float(wanted.detach()), rel=1e-5)
    assert here.planes.grad is not None
    exact = here.planes.grad.permute(2, 0, 1).numpy()
    np.testing.assert_allclose(by_planes, exact, atol=1e-5 * float(np.abs(exact).max()))
    assert not by_planes[:, :15, :20].any()
    assert by_planes[:, 28:, :].any()
    assert by_planes[:, 10:25, 25:30].any() != masks


def test_depth_that_is_measured_nowhere_has_no_loss() -> None:
    one = with_depths(views()[0])
    nothing = replace(one, photo=replace(one.photo, depth_m=np.zeros(SIZE_PX, np.float32)))
    loss, by_planes, _ = surface_slopes(nothing, None, alpha(), MEASURED, np.random.default_rng(0))
    assert loss == 0.0
    assert not by_planes.any()
