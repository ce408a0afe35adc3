import dataclasses

import pytest

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.lens import check_sensor
from readygo.services.renderer import RendererConfig
from readygo.services.renderer.sensor.recipes import SENSOR_RECIPES, sensor_off, sensor_phone_like

MOUNTED = CameraConfig(
    height_px=90, width_px=160, horizontal_fov_deg=90.0, mount_x_m=0.1, mount_pitch_deg=5.0, latency_s=0.1
)


def test_recipes_keep_what_is_not_optics() -> None:
    for recipe in SENSOR_RECIPES.values():
        camera, config = recipe(MOUNTED, RendererConfig(contact_shadow=True))
        assert sensor_off(camera, config) == (MOUNTED, dataclasses.replace(config, sensor=SensorConfig()))
        assert config.contact_shadow


def test_recipe_off_is_the_ideal_camera_whatever_there_was() -> None:
    phone = sensor_phone_like(CameraConfig(), RendererConfig())
    camera, config = sensor_off(*phone)
    assert camera == CameraConfig()
    assert not config.sensor.varies


def test_phone_is_a_camera_that_can_be_drawn_and_lies_amid_what_varies_of_it() -> None:
    camera, config = sensor_phone_like(CameraConfig(), RendererConfig())
    check_sensor(config.sensor, camera)
    assert not camera.ideal
    for name, ends in config.sensor.items():
        assert not ends or ends[0] < getattr(camera, name) < ends[1]


@pytest.mark.parametrize("intrinsics", [{"fx_px": 110.0, "fy_px": 111.0, "cx_px": 120.0, "cy_px": 70.0}])
def test_recipe_keeps_intrinsics_that_are_given(intrinsics) -> None:
    camera, config = sensor_phone_like(CameraConfig(**intrinsics), RendererConfig())
    check_sensor(config.sensor, camera)
    assert camera.K_px[0].tolist() == [110.0, 0.0, 120.0]
