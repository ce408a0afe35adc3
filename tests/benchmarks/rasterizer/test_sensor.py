import numpy as np
import pytest

from readygo.benchmarks.rasterizer import sensor
from readygo.benchmarks.rasterizer.setting import Setting


def test_robot_turns_at_the_place_and_humans_walk_on(setting: Setting) -> None:
    place = setting.places[0]
    timeline = sensor._timeline(setting, place)
    assert timeline.xyyaw[0].tolist() == [place.x_m, place.y_m, place.yaw_rad]
    assert np.diff(timeline.xyyaw[:, 2]) == pytest.approx(np.full(sensor.STEPS, 0.8 * 0.05))
    assert [human.avatar for human in timeline.humans] == [avatar.name for avatar in setting.avatars]
    for human, point in zip(timeline.humans, place.humans_m, strict=True):
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
