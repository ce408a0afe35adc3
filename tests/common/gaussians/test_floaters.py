import dataclasses

import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.gaussians.defects import told_apart, unwanted_masks, without
from readygo.common.gaussians.floaters import floating
from tests.common.maps.room import box, room


def furnished() -> GaussianCloud:
    return concatenate([room(4.0, 3.0), box((1, 1, 0), (2, 1.5, 0.8))])


def dust(count: int, *, size_m: float, low: tuple[float, ...], high: tuple[float, ...]) -> GaussianCloud:
    """Small Gaussians all over a box."""
    rng = np.random.default_rng(0)
    return GaussianCloud(
        means_m=rng.uniform(low, high, (count, 3)).astype(np.float32),
        quats_wxyz=rng.normal(size=(count, 4)).astype(np.float32),
        scales_m=rng.uniform(0.5, 1.5, (count, 3)).astype(np.float32) * np.float32(size_m),
        opacities=rng.uniform(0.05, 0.6, count).astype(np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


def found(scene: GaussianCloud, *more: GaussianCloud) -> tuple[float, float]:
    """Shares of a scene, and of what is added to it, that are taken for floaters."""
    cloud = concatenate([scene, *more])
    low, high = np.quantile(cloud.means_m.astype(np.float64), [0.01, 0.99], axis=0)
    mask = floating(cloud, low, high)
    return float(mask[: len(scene)].mean()), float(mask[len(scene) :].mean()) if more else 0.0


def test_sound_room_has_no_floaters() -> None:
    assert found(furnished()) == (0.0, 0.0)


@pytest.mark.parametrize(("count", "size_m"), [(20_000, 0.004), (60_000, 0.01)])
def test_dust_that_fills_a_room_floats_and_the_room_does_not(count: int, size_m: float) -> None:
    of_room, of_dust = found(furnished(), dust(count, size_m=size_m, low=(0.1, 0.1, 0.1), high=(3.9, 2.9, 2.4)))
    assert of_dust > 0.75
    assert of_room < 0.03


def test_thin_cloud_around_a_scene_floats() -> None:
    of_room, of_dust = found(furnished(), dust(900, size_m=0.03, low=(-9, -9, -9), high=(13, 12, 11)))
    assert of_dust > 0.9
    assert of_room < 0.05


def test_bush_of_large_leaves_is_none() -> None:
    leaves = dust(4000, size_m=0.05, low=(1, 1, 0.1), high=(2, 2, 1.2))
    leaves = dataclasses.replace(leaves, opacities=np.full(4000, 0.9, np.float32))
    assert found(furnished(), leaves)[1] < 0.05


def dome(count: int, *, radius_m: float, size_m: float) -> GaussianCloud:
    """Blobs on the upper half of a sphere around the room."""
    rays = np.random.default_rng(1).normal(size=(count, 3))
    rays[:, 2] = np.abs(rays[:, 2])
    far = dust(count, size_m=size_m, low=(0, 0, 0), high=(1, 1, 1))
    means = np.array([2, 1.5, 1]) + radius_m * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return dataclasses.replace(far, means_m=means.astype(np.float32), opacities=np.full(count, 0.9, np.float32))


def test_sky_of_few_large_gaussians_is_background_and_small_ones_there_float() -> None:
    scene, sky = furnished(), dome(60, radius_m=20.0, size_m=2.0)
    masks = told_apart(concatenate([scene, sky]))
    assert masks["background"][len(scene) :].mean() > 0.8
    assert not masks["background"][: len(scene)].any()
    masks = told_apart(concatenate([scene, dome(60, radius_m=20.0, size_m=0.05)]))
    assert not masks["background"].any()
    assert masks["floaters"][len(scene) :].all()


def test_coarse_room_around_a_detailed_corner_is_kept_and_cleaned_only_once() -> None:
    coarse = dust(600, size_m=0.6, low=(-6, -5, 0), high=(10, 8, 0.05))
    coarse = dataclasses.replace(coarse, opacities=np.full(600, 0.8, np.float32))
    assert found(furnished(), coarse)[1] < 0.1
    scene = concatenate([furnished(), coarse, dome(60, radius_m=30.0, size_m=2.0)])
    kept, _ = without(scene, unwanted_masks(scene))
    assert len(kept) > 0.97 * len(scene)
    assert unwanted_masks(kept)["floaters"].mean() < 0.01


def test_same_gaussians_float_as_did(golden_figures) -> None:
    """Of a room with dust, a thin cloud around it, a sky and haze: each Gaussian's kind."""
    parts = [
        furnished(), dust(3000, size_m=0.006, low=(0.3, 0.2, 0.4), high=(3.7, 2.6, 2.2)),
        dust(200, size_m=0.03, low=(-7, -8, -5), high=(12, 9, 8)), dome(60, radius_m=20.0, size_m=2.0),
        dust(40, size_m=0.5, low=(0, 0, 0), high=(4, 3, 2)),
    ]  # fmt: skip
    for number, cloud in enumerate([concatenate(parts), concatenate(parts[:2]), concatenate([parts[0], parts[3]])]):
        masks = told_apart(cloud)
        golden_figures(f"gaussians/kinds {number}", *masks.values())
        low, high = np.quantile(cloud.means_m.astype(np.float64), [0.01, 0.99], axis=0)
        golden_figures(
            f"gaussians/floating {number}", floating(cloud, low, high), np.arange(len(cloud)) % 97, scale=0.7
        )
