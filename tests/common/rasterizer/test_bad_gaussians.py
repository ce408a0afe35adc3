"""Whatever a scene holds, no image holds a NaN; what an import lets through is drawn as in the reference."""

import dataclasses

import numpy as np
import numpy.typing as npt
import pytest

from readygo.common.arrays import Float32Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.rasterizer.reference import rasterize_reference
from tests.common.rasterizer.drawing import float_rgb_of

K = np.array([[40.0, 0.0, 32.0], [0.0, 40.0, 24.0], [0.0, 0.0, 1.0]])
HEIGHT, WIDTH = 48, 64


def with_row(cloud: GaussianCloud, **values: npt.ArrayLike) -> GaussianCloud:
    """The cloud, in front of a camera at the origin, with other numbers for its Gaussian number 5."""
    arrays = {field.name: getattr(cloud, field.name).copy() for field in dataclasses.fields(GaussianCloud)}
    for name, value in values.items():
        arrays[name][5] = value
    return GaussianCloud(**arrays)


@pytest.fixture(scope="module")
def cloud(make_cloud) -> GaussianCloud:
    return make_cloud(600, coefficients=4, low=(-1.5, -1.0, 1.5), high=(1.5, 1.0, 5.0))


def draw(cloud: GaussianCloud) -> Float32Array:
    return float_rgb_of(CpuRasterizer(pack_cloud(cloud), {}, K, HEIGHT, WIDTH), np.eye(4))


SOUND = {
    "no size": {"scales_m": 0.0},
    "a needle": {"scales_m": (0.0, 0.0, 2.0)},
    "a disc": {"scales_m": (0.0, 3.0, 3.0)},
    "as large as allowed": {"scales_m": 1e4},
    "as large as allowed, around the camera": {"scales_m": 1e4, "means_m": (0.0, 0.0, 0.06)},
    "as large as allowed, behind": {"scales_m": 1e4, "means_m": (0.0, 0.0, -1e4)},
    "at the camera": {"means_m": 0.0, "opacities": 1.0},
    "near the near plane": {"means_m": (0.0, 0.0, 0.0501), "opacities": 1.0},
    "just behind": {"means_m": (0.0, 0.0, -1e-3), "scales_m": 5.0},
    "a sky far away": {"means_m": (100.0, 50.0, 1800.0), "scales_m": 300.0},
    "opaque": {"opacities": 1.0},
    "as bright as allowed": {"sh": 100.0},
}


@pytest.mark.parametrize("values", SOUND.values(), ids=SOUND.keys())
def test_extreme_gaussians_look_as_in_the_reference(cloud, values: dict[str, npt.ArrayLike]) -> None:
    extreme = with_row(cloud, **values)
    image, reference = draw(extreme), rasterize_reference(extreme, np.eye(4), K, HEIGHT, WIDTH).rgb
    assert np.isfinite(reference).all()
    assert np.isfinite(image).all()
    assert np.abs(np.clip(image, 0.0, 1.0) - np.clip(reference, 0.0, 1.0)).max() < 2 / 255


BAD = {
    "nowhere": {"means_m": np.nan},
    "infinitely far": {"means_m": np.inf},
    "very far": {"means_m": 1e30},
    "of no known size": {"scales_m": np.nan},
    "infinitely large": {"scales_m": np.inf},
    "very large": {"scales_m": 1e25},
    "a huge needle": {"scales_m": (1e15, 0.01, 0.01)},
    "of no rotation": {"quats_wxyz": 0.0},
    "of no known rotation": {"quats_wxyz": np.nan},
    "of no known opacity": {"opacities": np.nan},
    "of no known colour": {"sh": np.nan},
    "infinitely bright": {"sh": np.inf},
}


@pytest.mark.parametrize("values", BAD.values(), ids=BAD.keys())
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_gaussians_that_an_import_refuses_put_no_nan_into_images(cloud, values: dict[str, npt.ArrayLike]) -> None:
    assert np.isfinite(draw(with_row(cloud, **values))).all()
