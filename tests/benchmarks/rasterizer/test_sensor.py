from types import SimpleNamespace

import numpy as np
import pytest

from readygo.benchmarks.rasterizer import sensor
from readygo.benchmarks.rasterizer.setting import Setting


def test_robot_turns_at_the_place_and_humans_walk_on(setting: Setting) -> None:
    place = setting.places[0]
    shot, camera = sensor._shot(setting, place), SimpleNamespace(config=setting.camera)
    poses = np.stack([shot.pose_at(camera, step) for step in range(sensor.STEPS + 1)])
    floor_m = setting.scenery.floor.at(place.x_m, place.y_m)
    assert np.array_equal(poses[0], setting.camera.T_world_camera(place.x_m, place.y_m, place.yaw_rad, floor_m))
    yaws_rad = np.unwrap(np.arctan2(poses[:, 1, 2], poses[:, 0, 2]))
    assert np.diff(yaws_rad) == pytest.approx(np.full(sensor.STEPS, 0.8 * 0.05))
    assert shot.step == sensor.STEPS - 2
    assert [human.avatar for human in shot.humans] == [avatar.name for avatar in setting.avatars]
    for human, point in zip(shot.humans, place.humans_m, strict=True):
        assert human.motion.root_m[0, :2] == pytest.approx(point[:2], abs=1e-4)
        assert len(human.motion.root_m) == sensor.STEPS


@pytest.mark.parametrize("name", list(sensor.OPTICS))
def test_variant_has_what_its_name_says(name: str, setting: Setting, monkeypatch) -> None:
    made = []
    monkeypatch.setattr(sensor, "Renderer", lambda *arguments: made.append(arguments))
    sensor._renderer(name, None, {}, setting.camera)
    _, _, robot, config = made[0]
    assert config.contact_shadow == ("shadow" in name)
    assert config.feet_on_floor == ("feet" in name or "shadow" in name)
    assert config.human_light == ("human light" in name)
    assert (robot.camera.exposure_s > 0) == ("blur" in name or "phone" in name)
    if name == "off":
        assert robot.camera == setting.camera
