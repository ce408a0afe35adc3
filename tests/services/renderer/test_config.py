import dataclasses

import pytest

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.lens import check_sensor
from readygo.common.config import section_to_mapping
from readygo.common.errors import ConfigError
from readygo.common.rasterizer.backend_names import GPU_BACKENDS
from readygo.common.robot import RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.services.renderer import SENSOR_RECIPES, RendererConfig
from readygo.services.renderer.config import sensor_off, sensor_phone_like


def test_outputs_have_one_order() -> None:
    config = RendererConfig(outputs=("mask", "rgb", "depth", "mask"))
    assert config.outputs == ("rgb", "depth", "mask")
    assert config == RendererConfig(outputs=("rgb", "depth", "mask"))


@pytest.mark.parametrize("outputs", [(), ("depth",), ("rgb", "thermal"), ("rgb", "")])
def test_outputs_without_rgb_or_with_unknown_names_are_refused(outputs) -> None:
    with pytest.raises(ValueError, match=r"outputs must (hold rgb, got|be of rgb, depth, median_depth, .*, got)"):
        RendererConfig(outputs=outputs)


@pytest.mark.parametrize(
    "wrong",
    [
        {"backend": "cuda"},
        {"detail": "low"},
        {"detail": "lod", "backend": "reference"},
        {"image_format": "gif"},
        {"jpeg_quality": 0},
        {"jpeg_quality": 101},
        {"sub_frames": 1},
        {"sub_frames": 65},
        {"depth": "nearest"},
        {"backend": "gsplat", "outputs": ("rgb", "depth")},
        {"backend": "gsplat", "depth": "mean", "outputs": ("rgb", "mask")},
        {"backend": "gsplat", "outputs": ("rgb", "median_depth")},
    ],
)
def test_wrong_settings_are_refused(wrong) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        RendererConfig(**wrong)


def test_depth_is_made_of_the_median_unless_the_mean_is_asked_for() -> None:
    kinds = ("rgb", "depth", "median_depth", "mask")
    assert RendererConfig().rasterizer_outputs(kinds) == ("rgb", "median_depth", "mask")
    assert RendererConfig(depth="mean").rasterizer_outputs(kinds) == kinds
    assert RendererConfig(backend="gsplat", depth="mean", outputs=("rgb", "depth")).rasterizer_outputs(("depth",)) == (
        "depth",
    )


def test_settings_at_their_limits_are_taken() -> None:
    for quality, frames in ((1, 2), (100, 64)):
        config = RendererConfig(jpeg_quality=quality, sub_frames=frames)
        assert (config.jpeg_quality, config.sub_frames) == (quality, frames)
    assert RendererConfig(contact_shadow=True, backend="reference").contact_shadow
    assert RendererConfig(detail="lod").detail == "lod"


@pytest.mark.parametrize("name", ["contact_shadow", "feet_on_floor"])
def test_what_not_every_backend_draws_is_left_out_there(name: str) -> None:
    on = {name: True}
    assert all(RendererConfig(backend=backend, **on).draws(name) for backend in ("cpu", "reference"))
    assert not any(RendererConfig(backend=backend, **on).draws(name) for backend in GPU_BACKENDS)
    assert not RendererConfig(**{name: False}).draws(name)


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert section_to_mapping(RendererConfig()) == {
        "backend": "cpu",
        "image_format": "jpeg",
        "jpeg_quality": 90,
        "outputs": ["rgb"],
        "goal_image": False,
        "labels": True,
        "depth": "median",
        "detail": "exact",
        "contact_shadow": False,
        "feet_on_floor": True,
        "human_light": True,
        "human_look": "photoreal",
        "sensor": {
            "k1": [],
            "k2": [],
            "k3": [],
            "k4": [],
            "p1": [],
            "p2": [],
            "exposure_ev": [],
            "red_gain": [],
            "blue_gain": [],
            "vignetting": [],
            "shot_noise": [],
            "read_noise": [],
            "exposure_s": [],
            "readout_s": [],
        },
        "sub_frames": 8,
    }


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


def test_field_of_view_that_varies_is_refused_where_the_backend_draws_one() -> None:
    camera = CameraConfig(horizontal_fov_deg=90.0)
    wide = RobotConfig(camera=camera, ranges=RobotRanges(horizontal_fov_deg=(80.0, 100.0)))
    tall = RobotConfig(camera=camera, ranges=RobotRanges(mount_height_m=(0.3, 0.6)))
    for backend in GPU_BACKENDS:
        RendererConfig(backend=backend).check_robot(tall)
        with pytest.raises(ConfigError, match=f"the backend {backend} draws one field of view") as raised:
            RendererConfig(backend=backend).check_robot(wide)
        assert "\n" not in str(raised.value)
    for backend in ("cpu", "reference"):
        RendererConfig(backend=backend).check_robot(wide)
