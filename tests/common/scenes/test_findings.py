import numpy as np
import pytest

from readygo.common.camera.captured import CapturedViews
from readygo.common.gaussians import R_from_up, concatenate, transform_cloud
from readygo.common.maps import MapConfig, plan_scene
from readygo.common.scenes.findings import findings, goals_line
from readygo.common.scenes.report import scene_report
from tests.common.maps.crooked import crooked_scene
from tests.common.maps.room import box, room


def _findings(cloud, views=None):
    plan = plan_scene(cloud, MapConfig())
    return findings(cloud, plan, scene_report(cloud, None, plan.robot, plan.human, plan.floor, 0.3), views)


def _held_upright():
    """Four cameras that look along the horizon."""
    T = np.tile(np.eye(4), (4, 1, 1))
    for pose, angle in zip(T, np.arange(4) * np.pi / 2, strict=True):
        pose[:3, :3] = np.array([[-np.sin(angle), 0, np.cos(angle)], [np.cos(angle), 0, np.sin(angle)], [0, -1, 0]])
        pose[:3, 3] = 2.0, 2.0, 1.2
    return CapturedViews(
        T_world_camera=T,
        K_px=np.tile(np.diag([100.0, 100.0, 1.0]), (4, 1, 1)),
        sizes_px=np.full((4, 2), 200),
        images=("a", "b", "c", "d"),
    )


@pytest.fixture(scope="module")
def furnished():
    return concatenate([room(), box((1, 1, 0), (2, 1.5, 0.8)), box((3, 3, 0), (4.5, 4, 0.5))])


def test_sound_room_has_nothing_to_say(furnished):
    assert _findings(furnished) == []


def test_room_on_its_head_is_named(furnished):
    over = transform_cloud(furnished, R_from_up("-z"), (0, 0, 2.5))
    assert any("upside down" in sentence for sentence in _findings(over))


def test_cameras_know_better_than_gaussians_which_way_is_up(furnished):
    lying = transform_cloud(furnished, R_from_up("x"), (0, 0, 4.0))
    assert any("on its side" in sentence for sentence in _findings(lying))
    assert not any("on its side" in sentence for sentence in _findings(lying, _held_upright()))


def test_small_scale_is_named_with_what_mends_it(furnished):
    words = " ".join(_findings(transform_cloud(furnished, np.eye(3), scale=0.5)))
    assert "ceiling is 1.2" in words
    assert "scene scale" in words


def test_goals_that_are_too_far_are_named_with_the_distance_that_fits():
    assert goals_line(3.2, 3.0, 0.3) == ""
    assert "goal_distance_min_m below 2.6" in goals_line(2.6, 3.0, 0.3)
    assert "goal_distance_min_m" not in goals_line(0.8, 3.0, 0.3)


def test_second_floor_is_named_with_its_height(furnished):
    upper = transform_cloud(furnished, np.eye(3), (0, 0, 2.8))
    assert any(
        "another floor at about z = 2.8 m" in sentence for sentence in _findings(concatenate([furnished, upper]))
    )


def test_report_of_a_crooked_scene_is_as_it_was(golden_figures):
    cloud = crooked_scene()
    plan = plan_scene(cloud, MapConfig())
    report = scene_report(cloud, cloud.select(np.arange(50)), plan.robot, plan.human, plan.floor, 0.23)

    def numbers(part):
        for value in part.values() if isinstance(part, dict) else part if isinstance(part, (list, tuple)) else [part]:
            if isinstance(value, (dict, list, tuple)):
                yield from numbers(value)
            elif isinstance(value, (int, float)):
                yield float(value)

    golden_figures("scenes/report", list(numbers(report)))
