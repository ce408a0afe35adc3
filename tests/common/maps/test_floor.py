import dataclasses

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.gaussians import concatenate, load_gaussians
from readygo.common.maps import estimate_floor
from readygo.common.maps.floor import complete_floor
from tests.common.maps.crooked import crooked_scene
from tests.common.maps.room import box, room, sheet


def heights(estimate, points):
    return estimate.floor.at_many(np.array(points, dtype=np.float64))


def test_floor_of_a_room_is_its_lowest_surface():
    estimate = estimate_floor(room(), 0.1)
    np.testing.assert_allclose(heights(estimate, [(1, 1), (3, 2.5), (5, 4)]), 0.0, atol=0.01)


def test_tilted_floor_is_followed():
    points = [(1, 1), (3, 2.5), (5, 4)]
    found = heights(estimate_floor(room(tilt=0.03), 0.1), points)
    np.testing.assert_allclose(found, [0.03 * x for x, _ in points], atol=0.012)


def test_table_and_reflections_under_the_floor_do_not_move_it():
    table = sheet((2, 2, 0.75), (1.5, 0, 0), (0, 1, 0))
    reflection = sheet((1, 1, -0.09), (4, 0, 0), (0, 3, 0), opacity=0.5)
    estimate = estimate_floor(concatenate([room(), table, reflection]), 0.1)
    np.testing.assert_allclose(heights(estimate, [(2.5, 2.5), (3, 2.5), (1.5, 3.5)]), 0.0, atol=0.015)


def test_outside_of_the_room_no_floor_is_seen_but_a_height_is_given():
    estimate = estimate_floor(room(), 0.1)
    row, column = estimate.floor.frame.cell(-0.4, 2.0)
    assert not estimate.supported[row, column]
    assert abs(estimate.floor.at(-0.4, 2.0)) < 0.05
    assert np.isfinite(estimate.floor.height_m).all()


def test_floor_hidden_below_a_wide_box_has_no_support():
    cloud = room(8.0, 8.0)
    inside = (np.abs(cloud.means_m[:, :2] - 4.0) < 1.2).all(axis=1) & (cloud.means_m[:, 2] < 1)
    estimate = estimate_floor(concatenate([cloud.select(~inside), box((2.8, 2.8, 0.3), (5.2, 5.2, 1))]), 0.1)
    row, column = estimate.floor.frame.cell(4.0, 4.0)
    assert not estimate.supported[row, column]


@pytest.mark.parametrize(("opacity", "supported"), [(0.1, False), (0.35, True)])
def test_floor_that_is_too_faint_has_no_support(opacity, supported):
    cloud = room()
    x, y, z = cloud.means_m.T
    faint = (z < 0.01) & (np.abs(x - 3.0) < 0.9) & (np.abs(y - 2.5) < 0.9)
    opacities = np.where(faint, np.float32(opacity), cloud.opacities)
    estimate = estimate_floor(dataclasses.replace(cloud, opacities=opacities), 0.1)
    found = [estimate.supported[estimate.floor.frame.cell(x, 2.5)] for x in (1.0, 3.0)]
    assert found == [True, supported]


def test_object_without_floor_is_refused_with_its_area():
    with pytest.raises(SceneError, match=r"no floor: .* m2"):
        estimate_floor(box((0, 0, 0), (0.5, 0.5, 0.5)), 0.1)


def test_cloud_far_too_large_for_its_cells_is_refused():
    wide = sheet((0, 0, 0), (150, 0, 0), (0, 150, 0), spacing_m=0.6)
    with pytest.raises(SceneError, match="coarser resolution"):
        estimate_floor(wide, 0.02)


def test_floor_of_a_real_flat_is_where_its_dense_floor_gaussians_are(shared_data):
    from scipy.spatial import cKDTree

    from readygo.common.frames import matrix_from_quat

    cloud = load_gaussians(shared_data / "scenes" / "showroom.compressed.ply")
    estimate = estimate_floor(cloud, 0.1)
    above = cloud.means_m[:, 2] - estimate.floor.at_many(cloud.means_m[:, :2].astype(np.float64))
    lying = (np.abs(above) < 0.15) & (cloud.opacities > 0.5)
    thin = cloud.scales_m[lying].argmin(axis=1)
    upright = np.abs(matrix_from_quat(cloud.quats_wxyz[lying])[np.arange(len(thin)), 2, thin]) > 0.8
    tree = cKDTree(cloud.means_m[lying][upright, :2])
    frame = estimate.floor.frame
    cells = np.argwhere(estimate.supported)[::25]
    centres = np.stack([frame.centre_m(*cell) for cell in cells])
    near = tree.query_ball_point(centres, 0.25)
    errors = np.array([np.median(above[lying][upright][n]) for n in near if len(n) >= 10])
    assert len(errors) > 300
    assert (np.abs(errors) < 0.03).mean() > 0.85


def test_floor_is_complete_where_somebody_walked_who_filmed():
    estimate = estimate_floor(room(), 0.1)
    row, column = estimate.floor.frame.cell(3.0, 2.5)
    hidden = np.array(estimate.supported)
    hidden[row - 8 : row + 8, column - 8 : column + 8] = False
    estimate = dataclasses.replace(estimate, supported=hidden)
    way = np.array([[2.5, 2.5, 1.5], [3.3, 2.5, 1.5]])
    complete = complete_floor(estimate, way)
    assert complete.supported[row, column - 4 : column + 3].all()
    assert not complete.supported[row + 5, column]
    assert np.array_equal(complete_floor(estimate, way + np.array([0.0, 0.0, 3.0])).supported, hidden), (
        "filmed from above"
    )
    far = np.array([[2.2, 2.5, 1.5], [3.8, 2.5, 1.5]])
    assert not complete_floor(estimate, far).supported[row, column], "too far apart to be a step"


def test_floor_of_a_crooked_scene_is_as_it_was(golden_figures):
    for name, cell_m in (("fine", 0.06), ("coarse", 0.15)):
        estimate = estimate_floor(crooked_scene(), cell_m)
        golden_figures(f"maps/{name} estimate", 20.0 * estimate.floor.height_m.reshape(-1))
        seen = complete_floor(estimate, np.array([[0.1, 5.1, 1.8], [0.5, 5.4, 1.8], [0.9, 5.2, 1.9]]))
        golden_figures(f"maps/{name} walked", 20.0 * seen.floor.height_m.reshape(-1))
