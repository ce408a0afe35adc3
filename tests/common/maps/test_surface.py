import math

import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.maps.surface import sample_surfaces


def plate(tilt_deg=0.0, scales_m=(0.2, 0.1, 0.002), opacity=0.8):
    """One flat Gaussian at (1, 2, 3), turned about x."""
    half = math.radians(tilt_deg) / 2
    return GaussianCloud(
        means_m=np.float32([[1.0, 2.0, 3.0]]),
        quats_wxyz=np.float32([[math.cos(half), math.sin(half), 0.0, 0.0]]),
        scales_m=np.float32([scales_m]),
        opacities=np.float32([opacity]),
        sh=np.zeros((1, 1, 3), np.float32),
    )


def area_m2(cloud, spacing_m=0.05):
    return float(sample_surfaces(cloud, spacing_m).area_m2.sum())


def test_samples_share_the_area_within_one_sigma_times_opacity():
    samples = sample_surfaces(plate(), 0.05)
    assert len(samples.area_m2) > 10
    assert samples.area_m2.sum() == pytest.approx(0.8 * math.pi * 0.2 * 0.1, rel=1e-5)
    offset = (samples.xyz_m - (1.0, 2.0, 3.0)) / (0.2, 0.1, 1.0)
    assert np.hypot(offset[:, 0], offset[:, 1]).max() <= 1.0
    assert np.abs(offset[:, 2]).max() < 1e-6
    assert samples.xyz_m.mean(axis=0) == pytest.approx((1.0, 2.0, 3.0), abs=1e-5)


def test_small_gaussian_is_one_sample():
    assert len(sample_surfaces(plate(), 1.0).area_m2) == 1


def test_tilted_plate_covers_less_ground_and_steep_ones_are_no_floor():
    assert area_m2(plate(30.0)) == pytest.approx(area_m2(plate()) * math.cos(math.radians(30.0)), rel=1e-5)
    assert area_m2(plate(36.0)) > 0
    assert area_m2(plate(38.0)) == 0.0
    assert area_m2(plate(90.0)) == 0.0


def test_samples_of_a_tilted_plate_lie_on_it():
    xyz = sample_surfaces(plate(20.0), 0.05).xyz_m - (1.0, 2.0, 3.0)
    assert xyz[:, 2] == pytest.approx(math.tan(math.radians(20.0)) * xyz[:, 1], abs=1e-6)


@pytest.mark.parametrize(("opacity", "covers"), [(0.09, False), (0.11, True)])
def test_haze_is_no_floor(opacity, covers):
    assert (area_m2(plate(opacity=opacity)) > 0) is covers


@pytest.mark.parametrize(("scales_m", "covers"), [((0.2, 0.2, 0.15), False), ((0.02, 0.02, 0.02), True)])
def test_thick_gaussian_is_floor_only_where_it_is_small(scales_m, covers):
    assert (area_m2(plate(scales_m=scales_m)) > 0) is covers


def test_samples_of_turned_plates_are_as_they_were(golden_figures):
    plates = [(17.0, (0.2, 0.1, 0.002)), (-20.0, (0.3, 0.12, 0.004)), (9.0, (0.2, 0.31, 0.01))]
    for number, (tilt_deg, scales_m) in enumerate(plates):
        samples = sample_surfaces(plate(tilt_deg, scales_m, 0.63), 0.037)
        golden_figures(f"maps/surface {number}", samples.xyz_m, 1e3 * samples.area_m2)
