"""Gradients of a view against differences of its loss."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from readygo.services.reconstructor.training.config import DensityConfig, GaussiansConfig, GeometryConfig
from readygo.services.reconstructor.training.drawing import (
    Geometry,
    ViewGradients,
    draw,
    leaves_of,
    observe,
    planes_of,
    view_gradients,
)
from readygo.services.reconstructor.training.parameters import Gaussians
from readygo.services.reconstructor.training.photometric import SSIM_WEIGHT, Photometric
from readygo.services.reconstructor.training.photos import Photo
from tests.services.reconstructor.training.conftest import SIZE_PX, camera, true_gaussians

PLAIN = GaussiansConfig(density=DensityConfig(method="gradients"))
SURFACES = replace(PLAIN, geometry=GeometryConfig(enabled=True, noise_px=3.0, flatten=0.0))


def photo_of(number: int) -> Photo:
    rng = np.random.default_rng(number)
    return replace(camera(number), rgb=rng.random((3, *SIZE_PX), dtype=np.float32))


def gradients(gaussians: Gaussians, settings: GaussiansConfig, exposure: np.ndarray | None = None) -> ViewGradients:
    exposure = np.zeros((2, 3), np.float32) if exposure is None else exposure
    geometry = Geometry(neighbour=photo_of(3), rng=np.random.default_rng(0)) if settings.geometry.enabled else None
    return view_gradients(leaves_of(gaussians), photo_of(2), exposure, 0, settings, geometry)


def test_gradients_are_those_through_exponential_and_sigmoid() -> None:
    gaussians = true_gaussians()
    gaussians.values["log_scales"] += np.random.default_rng(1).normal(0, 0.2, (150, 3)).astype(np.float32)
    found, photo = gradients(gaussians, PLAIN), photo_of(2)
    stored = {name: torch.tensor(value, requires_grad=True) for name, value in gaussians.values.items()}
    leaves = {
        "means_m": stored["means_m"],
        "quats_wxyz": stored["quats_wxyz"],
        "scales_m": torch.exp(stored["log_scales"]),
        "opacities": torch.sigmoid(stored["logits"])[:, 0],
        "sh": stored["sh"].reshape(150, -1, 3),
    }
    rendered = draw(leaves, photo, 0)
    loss, _, slope = Photometric(*SIZE_PX)(planes_of(rendered), photo.rgb, SSIM_WEIGHT)
    assert rendered.rgb is not None
    rendered.rgb.backward(torch.from_numpy(slope).permute(1, 2, 0))
    assert found.loss == pytest.approx(loss)
    for name, tensor in stored.items():
        assert tensor.grad is not None
        whole = np.zeros(tensor.shape, dtype=np.float32)
        whole[found.rows] = found.gradients[name]
        np.testing.assert_allclose(whole, tensor.grad.numpy(), atol=1e-6 * float(tensor.grad.abs().max()))


def test_gradients_by_exposure_are_slopes_of_the_loss() -> None:
    gaussians = true_gaussians()
    exposure = np.array([[0.1, -0.1, 0.0], [0.02, 0.0, -0.02]], dtype=np.float32)
    found = gradients(gaussians, PLAIN, exposure)
    for place in np.ndindex(2, 3):
        step = np.zeros((2, 3), np.float32)
        step[place] = 1e-2
        difference = (
            gradients(gaussians, PLAIN, exposure + step).loss - gradients(gaussians, PLAIN, exposure - step).loss
        )
        assert difference / 2e-2 == pytest.approx(found.exposure[place], rel=0.05, abs=2e-4)


def test_surfaces_change_shapes_of_what_the_neighbour_shows_and_no_colours() -> None:
    gaussians = true_gaussians()
    gaussians.values["log_scales"][:, 2] -= 2.0
    plain, shaped = gradients(gaussians, PLAIN), gradients(gaussians, SURFACES)
    assert shaped.loss > plain.loss
    assert set(plain.rows) <= set(shaped.rows)
    place = np.searchsorted(shaped.rows, plain.rows)
    np.testing.assert_allclose(shaped.gradients["sh"][place], plain.gradients["sh"], atol=1e-9)
    assert np.abs(shaped.gradients["quats_wxyz"][place] - plain.gradients["quats_wxyz"]).max() > 1e-6


def test_view_that_shows_nothing_still_says_what_its_neighbour_wants() -> None:
    gaussians = true_gaussians()
    away = np.eye(4)
    away[2, 3] = 50.0
    blind = replace(photo_of(2), T_world_camera=away)
    geometry = Geometry(neighbour=photo_of(3), rng=np.random.default_rng(0))
    found = view_gradients(leaves_of(gaussians), blind, np.zeros((2, 3), np.float32), 0, SURFACES, geometry)
    assert not len(found.moved_rows)
    assert found.gradients["sh"].shape == (len(found.rows), 3)
    assert not found.gradients["sh"].any()


def test_flattening_pulls_the_shortest_axis_alone() -> None:
    gaussians = true_gaussians()
    gaussians.values["log_scales"][:, 1] -= 1.0
    flat = replace(PLAIN, geometry=GeometryConfig(enabled=True, flatten=10.0))
    difference = (
        view_gradients(leaves_of(gaussians), photo_of(2), np.zeros((2, 3), np.float32), 0, flat).gradients["log_scales"]
        - gradients(gaussians, PLAIN).gradients["log_scales"]
    )
    assert (difference[:, 1] > 0).all()
    np.testing.assert_allclose(difference[:, [0, 2]], 0.0, atol=1e-9)


def test_gaussians_behind_the_camera_are_not_observed() -> None:
    gaussians = true_gaussians()
    gaussians.values["means_m"][7] = [0.0, 0.0, -2.0]
    rows = observe(leaves_of(gaussians), camera(2))
    assert 7 not in rows
    assert len(rows) > 75
    assert 0 < len(observe(leaves_of(gaussians), camera(2), 20.0)) < len(rows)


def test_picture_has_the_size_of_its_photo() -> None:
    assert planes_of(draw(leaves_of(true_gaussians()), camera(0), 0)).shape == (3, *SIZE_PX)


def test_what_is_masked_has_neither_loss_nor_gradients() -> None:
    gaussians, exposure = true_gaussians(), np.array([[0.1, 0.0, 0.0], [0.0, 0.02, 0.0]], np.float32)
    mask = np.ones(SIZE_PX, np.bool_)
    mask[:, :20] = False
    one, noise = photo_of(2), photo_of(5).rgb
    other = replace(one, rgb=np.where(mask, one.rgb, noise))
    found = [
        view_gradients(leaves_of(gaussians), replace(photo, mask=mask), exposure, 0, PLAIN) for photo in (one, other)
    ]
    assert found[0].loss == found[1].loss
    np.testing.assert_array_equal(found[0].exposure, found[1].exposure)
    for name, values in found[0].gradients.items():
        np.testing.assert_array_equal(values, found[1].gradients[name])
    assert found[0].loss < view_gradients(leaves_of(gaussians), one, exposure, 0, PLAIN).loss
    nothing = replace(one, mask=np.zeros(SIZE_PX, np.bool_))
    empty = view_gradients(leaves_of(gaussians), nothing, exposure, 0, PLAIN)
    assert empty.loss == pytest.approx(0.0, abs=1e-6)
    assert not any(values.any() for values in empty.gradients.values())
    assert not empty.exposure.any()
