"""Named cameras: lens, light and shutter of the robot's camera together with what varies of them."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Literal

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.config import COEFFICIENT_NAMES, SENSOR_LIMITS
from readygo.services.renderer.config import RendererConfig

SensorName = Literal["off", "sensor_phone_like"]
"""Names of the recipes in `SENSOR_RECIPES`."""
SensorRecipe = Callable[[CameraConfig, RendererConfig], tuple[CameraConfig, RendererConfig]]
"""Gives a camera and the way that it is drawn other optics; image size, intrinsics, mount and latency are kept."""


def sensor_off(camera: CameraConfig, renderer: RendererConfig) -> tuple[CameraConfig, RendererConfig]:
    """The ideal pinhole camera."""
    changed = {"distortion", *COEFFICIENT_NAMES, *SENSOR_LIMITS}
    kept = {
        entry.name: getattr(camera, entry.name) for entry in dataclasses.fields(camera) if entry.name not in changed
    }
    return CameraConfig(**kept), dataclasses.replace(renderer, sensor=SensorConfig())


def sensor_phone_like(camera: CameraConfig, renderer: RendererConfig) -> tuple[CameraConfig, RendererConfig]:
    """A small camera module as in a phone: slight distortion, noise, motion blur and rolling shutter, all varied."""
    plain, _ = sensor_off(camera, renderer)
    sensor = SensorConfig(
        k1=(-0.04, 0.01),
        k2=(-0.002, 0.006),
        p1=(-0.001, 0.001),
        p2=(-0.001, 0.001),
        exposure_ev=(-0.3, 0.3),
        red_gain=(0.92, 1.08),
        blue_gain=(0.92, 1.08),
        vignetting=(0.05, 0.3),
        shot_noise=(0.005, 0.02),
        read_noise=(0.0005, 0.002),
        exposure_s=(1 / 200, 1 / 60),
        readout_s=(0.010, 0.020),
    )
    phone = sensor.middle(dataclasses.replace(plain, distortion="brown_conrady"))
    return phone, dataclasses.replace(renderer, sensor=sensor, sub_frames=4)


SENSOR_RECIPES: Mapping[SensorName, SensorRecipe] = {
    "off": sensor_off,
    "sensor_phone_like": sensor_phone_like,
}
"""Recipes by the name that the command line takes."""
