import dataclasses

import numpy as np
import pytest

from readygo.common.errors import NoGroundError
from readygo.common.frames import matrix_from_axis_angle
from readygo.common.gaussians import R_from_up, concatenate, transform_cloud
from readygo.common.gaussians.files import read_source, with_unit_rotations
from readygo.common.scenes.survey import advice, resolve_up, survey, survey_row
from tests.common.maps.room import box, room, sheet


def furnished():
    """A room of 6 x 5 x 2.5 m with things that stand on its floor."""
    return concatenate(
        [room(), box((1, 1, 0), (2, 1.5, 0.8)), box((3, 3, 0), (4.5, 4, 0.5)), box((5, 0.5, 0), (5.5, 1, 1))]
    )


def courtyard():
    """Uneven ground of 101 x 101 m with stalls, and a front of 14 m that is as plane as a floor."""
    ground = sheet((0, 0, 0), (101, 0, 0), (0, 101, 0), spacing_m=0.8)
    means = ground.means_m.copy()
    means[:, 2] = 1.5 * np.sin(means[:, 0] / 12) * np.cos(means[:, 1] / 15)
    stalls = [
        sheet((x, y, 0), (3, 0, 0), (0, 0, 2.5), spacing_m=0.4) for x in range(10, 90, 10) for y in (8, 20, 35, 60)
    ]
    front = sheet((0, 0, 0), (101, 0, 0), (0, 0, 14), spacing_m=0.8)
    return concatenate([dataclasses.replace(ground, means_m=means), front, *stalls])


@pytest.mark.parametrize("up", ["+z", "-z", "-y", "+x"])
def test_up_is_where_furniture_stands_on_the_floor(up):
    in_file = transform_cloud(furnished(), R_from_up(up).T)
    assert survey(in_file).clear_up.name == up
    assert resolve_up("auto", lambda: in_file) == up


def test_tilted_file_in_millimetres_gives_a_direction_and_its_scale():
    R = matrix_from_axis_angle([0.3, -0.5, 1.2])
    found = survey(transform_cloud(furnished(), R, scale=1000))
    np.testing.assert_allclose(found.clear_up.up, R[:, 2], atol=0.02)
    assert found.scales[0].metres_per_unit == pytest.approx(0.001, rel=0.05)
    level = R_from_up(found.clear_up.name) @ R
    assert level[2, 2] == pytest.approx(1.0, abs=1e-3)


def test_heap_has_no_up_and_says_so():
    rng = np.random.default_rng(0)
    heap = box((0, 0, 0), (1, 1, 1))
    heap = type(heap)(
        means_m=rng.normal(size=(3000, 3)).astype(np.float32),
        quats_wxyz=(q := rng.normal(size=(3000, 4)).astype(np.float32)) / np.linalg.norm(q, axis=1, keepdims=True),
        scales_m=np.full((3000, 3), [0.1, 0.1, 0.01], np.float32),
        opacities=np.full(3000, 0.9, np.float32),
        sh=np.zeros((3000, 1, 3), np.float32),
    )
    assert survey(heap).clear_up is None
    with pytest.raises(NoGroundError, match="is clearly up"):
        resolve_up("auto", lambda: heap)


def test_advice_names_the_options_that_differ_from_those_given():
    found = survey(transform_cloud(furnished(), R_from_up("-y").T, scale=0.1))
    words = advice(found, "+z", 1.0)
    assert "--up=-y" in words
    assert "--scale 10" in words
    assert "Try" not in advice(found, "-y", 10.0)
    assert survey_row(found)["up_candidates"][0]["up"] == "-y"


def test_cameras_choose_among_floors_and_stand_in_for_them():
    in_file = transform_cloud(furnished(), R_from_up("-y").T)
    tilted = np.array([0.1, -0.98, 0.15]) / np.linalg.norm([0.1, -0.98, 0.15])
    assert resolve_up("auto", lambda: in_file, tilted) == "-y"
    np.testing.assert_allclose(R_from_up(resolve_up("cameras", lambda: in_file, tilted))[2], tilted, atol=1e-3)
    askew = np.array([0.6, -0.6, 0.53]) / np.linalg.norm([0.6, -0.6, 0.53])
    np.testing.assert_allclose(R_from_up(resolve_up("auto", lambda: in_file, askew))[2], askew, atol=1e-3)


@pytest.mark.parametrize("up", ["+z", "-y"])
def test_best_candidate_that_is_not_clear_is_offered_with_the_option_that_takes_it(up):
    found = survey(transform_cloud(courtyard(), R_from_up(up).T))
    assert found.clear_up is None
    words = advice(found, "auto", 1.0)
    assert words.startswith(f"Try --up={up} (the best candidate: 71 % of the scene is above its floor; --up=")
    assert words.endswith(" has 90 % of its score).")
    assert advice(found, up, 1.0) == "No other axes or scale suggest themselves; --crop away what surrounds it."
    small = dataclasses.replace(found, low=np.zeros(3), high=np.ones(3))
    assert "is it an object? If it is a place" in advice(small, up, 1.0)


def test_real_object_is_offered_its_best_candidate(shared_data):
    found = survey(with_unit_rotations(read_source(shared_data / "scenes" / "guitar.ply").cloud))
    assert found.clear_up is None
    assert advice(found, "auto", 1.0).startswith(f"Try --up={found.ups[0].name} (the best candidate: ")


def test_survey_of_a_tilted_file_is_as_it_was(golden_figures):
    uneven = [
        sheet((0.4, 0.3, 0.02), (2.1, 0.0, 0.1), (0.0, 1.9, 0.07), spacing_m=0.15, opacity=0.6),
        sheet((2.6, 2.2, 0.0), (2.4, 0.1, -0.06), (0.1, 2.1, 0.09), spacing_m=0.04),
        sheet((1.0, 1.1, 1.2), (0.0, 0.9, 0.05), (0.0, 0.1, 0.9), spacing_m=0.11),
    ]
    cloud = concatenate([furnished(), *uneven])
    found = survey(transform_cloud(cloud, matrix_from_axis_angle([0.4, 0.2, -0.9]), (1.0, -2.0, 0.5), 3.1))
    golden_figures("scenes/survey", [[found.gaussians / 1e3, *found.low, *found.high]])
    ups = [
        [*up.up, up.floor, 9 * up.support, up.above, 9 * up.standing, len(up.levels), up.ceiling or -1.0]
        for up in found.ups
    ]
    golden_figures("scenes/ups", ups)
    golden_figures("scenes/up levels", [level for up in found.ups for level in up.levels])
    golden_figures("scenes/scales", [scale.metres_per_unit for scale in found.scales])
