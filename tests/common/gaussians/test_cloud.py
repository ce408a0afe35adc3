import dataclasses

import numpy as np
import pytest


@pytest.mark.parametrize(("coefficients", "degree"), [(1, 0), (4, 1), (9, 2), (16, 3)])
def test_degree_follows_from_the_number_of_coefficients(make_cloud, coefficients, degree):
    assert make_cloud(3, coefficients=coefficients).sh_degree == degree


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("quats_wxyz", np.zeros((5, 3), np.float32)),
        ("scales_m", np.zeros((4, 3), np.float32)),
        ("opacities", np.zeros((5, 1), np.float32)),
        ("means_m", np.zeros((5, 3))),
        ("sh", np.zeros((5, 5, 3), np.float32)),
        ("sh", np.zeros((5, 4, 4), np.float32)),
        ("sh", np.zeros((5, 4, 3))),
        ("sh", np.zeros((4, 4, 3), np.float32)),
    ],
)
def test_arrays_of_another_shape_or_type_are_refused_by_name(make_cloud, name, array):
    with pytest.raises(ValueError, match=f"{name} must"):
        dataclasses.replace(make_cloud(5, coefficients=4), **{name: array})


def test_selection_by_mask_and_by_numbers_takes_the_same_rows_of_every_array(make_cloud):
    cloud = make_cloud(6, coefficients=4)
    mask = np.array([True, False, False, True, False, False])
    for selected in (cloud.select(mask), cloud.select(np.array([0, 3]))):
        assert len(selected) == 2
        for field in dataclasses.fields(cloud):
            np.testing.assert_array_equal(getattr(selected, field.name), getattr(cloud, field.name)[[0, 3]])
