from pathlib import Path

import pytest

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError
from readygo.common.messages import Split
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.identity import numeric_class
from readygo.runs.spec import make_spec
from readygo.services.renderer import RendererConfig
from readygo.services.renderer.config import sensor_phone_like


def written(folder: Path, text: str) -> Path:
    (folder / "run.toml").write_text(text)
    return folder / "run.toml"


def test_recipe_takes_the_place_of_optics_and_variation(tmp_path: Path) -> None:
    text = "[renderer]\ncontact_shadow = true\n[renderer.sensor]\nexposure_ev = [0.0, 1.0]\n[robot.camera]\nk1 = 0.1\n"
    file = written(tmp_path, text + "distortion = 'fisheye'\nmount_x_m = 0.1\n")
    plain = load_run_config(file)
    assert plain.renderer.sensor == SensorConfig(exposure_ev=(0.0, 1.0))
    assert plain.robot.camera == CameraConfig(distortion="fisheye", k1=0.1, mount_x_m=0.1)
    config = load_run_config(file, sensor="sensor_phone_like")
    expected = sensor_phone_like(CameraConfig(mount_x_m=0.1), RendererConfig(contact_shadow=True))
    assert (config.robot.camera, config.renderer) == expected
    assert numeric_class(config) == numeric_class(RunConfig())


def test_recipe_is_laid_over_the_robot_that_is_given() -> None:
    robot = RobotConfig(v_max_mps=0.5, camera=CameraConfig(height_px=72, width_px=128))
    config = load_run_config(None, robot, "sensor_phone_like")
    assert config.robot.v_max_mps == 0.5
    assert (config.robot.camera.height_px, config.robot.camera.distortion) == (72, "brown_conrady")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("k1 = 0.1", r"renderer\.sensor\.k1 must be an array, got 0\.1"),
        ("distortion = 'fisheye'", "Unknown key 'renderer.sensor.distortion'; known keys: "),
        ("gamma = 2.2", "Unknown key 'renderer.sensor.gamma'"),
    ],
)
def test_constants_are_refused_where_ranges_are_expected(tmp_path: Path, text: str, message: str) -> None:
    file = written(tmp_path, f"[renderer.sensor]\n{text}\n")
    with pytest.raises(ConfigError, match=message) as caught:
        load_run_config(file)
    assert str(caught.value).startswith(f"Configuration {file}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["robot = 3", "renderer = 3", "[renderer]\nsensor = 3", "[robot]\ncamera = 3"])
def test_section_that_is_no_table_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match="must be a table"):
        load_run_config(written(tmp_path, text))


def test_lens_that_folds_the_robots_image_is_refused_before_the_run() -> None:
    camera = {"distortion": "brown_conrady", "k1": -0.4}
    config = section_from_mapping(RunConfig, {"robot": {"camera": camera}})

    class SceneThatIsNotReached:
        pass

    with pytest.raises(ConfigError, match=r"k1 -0\.4.* folds the image"):
        make_spec(SceneThatIsNotReached(), None, config, seed=0, split=Split.TRAIN, static=True)  # type: ignore[arg-type]
