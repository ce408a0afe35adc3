"""The floor among the lying layers of coarse columns."""

import numpy as np
import pytest

from readygo.common.maps.floor_layers import (
    COLUMN_M,
    EXTENT_MAX_M,
    STEP_MAX_M,
    CoarseFloor,
    _rises_above_neighbours,
    find_coarse_floor,
)
from readygo.common.maps.surface import SurfaceSamples, sample_surfaces
from tests.common.maps.crooked import crooked_scene

SPACING_M = 0.1


def plate(
    low_m: tuple[float, float], high_m: tuple[float, float], z_m: float, *, slope: float = 0.0, cover: float = 1.0
):
    """Samples of a level or rising rectangle, of which a part is covered: rows of x, y, z, area."""
    x, y = np.meshgrid(*(np.arange(a + SPACING_M / 2, b, SPACING_M) for a, b in zip(low_m, high_m, strict=True)))
    x, y = x.reshape(-1), y.reshape(-1)
    return np.stack([x, y, z_m + slope * x, np.full(len(x), cover * SPACING_M**2)], axis=1)


def found(*plates: np.ndarray) -> CoarseFloor | None:
    rows = np.concatenate(plates).astype(np.float32)
    return find_coarse_floor(SurfaceSamples(xyz_m=rows[:, :3], area_m2=rows[:, 3]))


def heights(floor: CoarseFloor | None) -> np.ndarray:
    assert floor is not None
    return floor.height_m


FLOOR = plate((0.0, 0.0), (4.0, 3.2), 0.0)


def test_level_floor_is_found_with_its_area_and_place() -> None:
    floor = found(FLOOR)
    assert floor is not None
    assert floor.height_m == pytest.approx(np.zeros((8, 10)), abs=1e-6)
    assert floor.area_m2 == pytest.approx(12.8, rel=1e-3)
    assert (floor.frame.origin_x_m, floor.frame.origin_y_m, floor.frame.resolution_m) == (0.0, 0.0, COLUMN_M)


def test_ceiling_as_large_as_the_floor_is_not_taken_for_it() -> None:
    assert heights(found(FLOOR, plate((0.0, 0.0), (4.0, 3.2), 2.5))) == pytest.approx(np.zeros((8, 10)), abs=1e-6)


def test_small_surface_below_is_no_floor() -> None:
    pit = plate((0.8, 0.8), (2.0, 2.0), -1.0)
    assert heights(found(FLOOR, pit)) == pytest.approx(np.zeros((8, 10)), abs=1e-6)


def test_table_does_not_lift_the_floor_and_leaves_a_gap_where_it_hides_it() -> None:
    hidden = ((FLOOR[:, :2] > 1.2) & (FLOOR[:, :2] < 2.0)).all(axis=1)
    height_m = heights(found(FLOOR[~hidden], plate((1.2, 1.2), (2.0, 2.0), 0.7)))
    assert np.isnan(height_m[3:5, 3:5]).all()
    assert np.nanmax(np.abs(height_m)) < 1e-6
    assert np.isnan(height_m).sum() == 4


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_hump_and_pit_that_a_slope_joins_to_the_floor_are_left_out(side: float) -> None:
    ring, middle = (((low < FLOOR[:, :2]) & (FLOOR[:, :2] < 2.8 - low)).all(axis=1) for low in (0.8, 1.2))
    ground = FLOOR.copy()
    ground[ring, 2] = 0.14 * side
    ground[middle, 2] = 0.28 * side
    height_m = heights(found(ground))
    assert np.argwhere(np.isnan(height_m)).tolist() == [[3, 3]]
    assert height_m[2:5, 2:5].ravel()[[0, 1, 2, 3, 5, 6, 7, 8]] == pytest.approx(np.full(8, 0.14 * side), abs=1e-6)


def test_column_is_compared_with_the_median_of_the_known_columns_about_it() -> None:
    rng = np.random.default_rng(3)
    height_m = rng.normal(0.0, 0.12, (7, 11))
    height_m[rng.random(height_m.shape) < 0.2] = np.nan
    expected = np.zeros(height_m.shape, np.bool_)
    for i, j in np.ndindex(height_m.shape):
        about = height_m[max(i - 2, 0) : i + 3, max(j - 2, 0) : j + 3]
        expected[i, j] = abs(height_m[i, j] - np.median(about[np.isfinite(about)])) > STEP_MAX_M
    assert expected.any()
    np.testing.assert_array_equal(_rises_above_neighbours(height_m), expected)


def test_rising_floor_is_one_surface_and_a_step_is_not() -> None:
    ramp = heights(found(plate((0.0, 0.0), (8.0, 3.2), 0.0, slope=0.2)))
    assert ramp[:, -1] - ramp[:, 0] == pytest.approx(np.full(8, 0.2 * 19 * COLUMN_M), abs=0.02)
    stage = heights(found(plate((0.0, 0.0), (4.8, 3.2), 0.0), plate((4.8, 0.0), (8.0, 3.2), 0.4)))
    assert np.isfinite(stage[:, :12]).all()
    assert np.isnan(stage[:, 12:]).all()


@pytest.mark.parametrize(("cover", "seen"), [(0.1, False), (0.3, True)])
def test_layer_that_covers_little_is_none(cover: float, seen: bool) -> None:
    assert (found(plate((0.0, 0.0), (4.0, 3.2), 0.0, cover=cover)) is not None) == seen


def test_far_background_is_left_out() -> None:
    far = plate((EXTENT_MAX_M + 100.0, 0.0), (EXTENT_MAX_M + 104.0, 1.0), -3.0)
    assert heights(found(FLOOR, far)).shape == (8, 10)


def test_nothing_has_no_floor() -> None:
    assert found(np.zeros((0, 4))) is None


def test_coarse_floor_of_a_crooked_scene_is_as_it_was(golden_figures) -> None:
    floor = find_coarse_floor(sample_surfaces(crooked_scene(), 0.05))
    assert floor is not None
    golden_figures("maps/coarse floor", np.nan_to_num(20.0 * floor.height_m.reshape(-1), nan=-99.0))
    golden_figures("maps/coarse area", [[floor.area_m2, floor.frame.origin_x_m, floor.frame.origin_y_m]])
