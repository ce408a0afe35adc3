import dataclasses

import numpy as np
import pytest

from readygo.benchmarks.rasterizer.scenery import (
    TURN_RAD,
)
from readygo.benchmarks.rasterizer.setting import Setting
from readygo.common.errors import ConfigError
from tests.benchmarks.rasterizer.conftest import JOB


def test_humans_walk_and_the_camera_turns_with_every_image(setting: Setting) -> None:
    place = setting.places[0]
    first, second = setting.view(place, 0), setting.view(place, 1)
    assert np.arccos(first.T_world_camera[:3, 2] @ second.T_world_camera[:3, 2]) == pytest.approx(TURN_RAD, rel=1e-3)
    for before, after, point in zip(first.humans, second.humans, place.humans_m, strict=True):
        assert before.root_m[:2] == pytest.approx(point[:2], abs=1e-5)
        assert 0.02 < np.linalg.norm(after.root_m - before.root_m) < 0.12
        assert not np.array_equal(before.pose_axis_angle, after.pose_axis_angle)


@pytest.mark.parametrize(
    ("wrong", "message"), [({"views": 0}, "--views must be at least 1"), ({"avatars": -1}, "not be negative")]
)
def test_job_without_sense_is_refused(wrong: dict[str, int], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        dataclasses.replace(JOB, **wrong)


def test_humans_are_out_of_step_and_in_the_cloud_for_those_who_pose_nobody(setting: Setting) -> None:
    view = setting.view(setting.places[0], 0)
    assert [human.avatar for human in view.humans] == [avatar.name for avatar in setting.avatars]
    assert not np.array_equal(view.humans[0].pose_axis_angle, view.humans[1].pose_axis_angle)
    scene = setting.avatars[0].cloud
    assert len(setting.cloud(scene, view.humans)) == len(scene) + sum(len(avatar.cloud) for avatar in setting.avatars)
    assert setting.cloud(scene, []) is scene
