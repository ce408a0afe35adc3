import dataclasses
import sys
from pathlib import Path

import pytest

from readygo.__main__ import main
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError
from readygo.common.policy import PolicySpec
from readygo.common.robot import Clock, RobotConfig
from readygo.runs.config import RunConfig, check_cameras, load_run_config, resolved_sections
from readygo.runs.identity import run_name
from readygo.runs.origin import robot_of_policy
from tests.common.messages.run_specs import SPEC


def test_outputs_of_the_command_line_become_settings() -> None:
    config = load_run_config(None, keys={"renderer": {"outputs": ["mask", "rgb", "depth"]}})
    assert config.renderer.outputs == ("rgb", "depth", "mask")
    sections = resolved_sections(config)
    assert sections["renderer"]["outputs"] == ["rgb", "depth", "mask"]
    assert section_from_mapping(RunConfig, sections) == config
    assert run_name(dataclasses.replace(SPEC, config=sections)) != run_name(
        dataclasses.replace(SPEC, config=resolved_sections(RunConfig()))
    )


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("rgb,thermal", "--renderer.outputs must be of rgb, depth, median_depth, alpha, mask, normal, got 'thermal'."),
        ("depth,mask", "--renderer.outputs must hold rgb, got depth, mask; add it."),
        ("rgb,,depth", "--renderer.outputs must be of rgb, depth, median_depth, alpha, mask, normal, got ''."),
    ],
)
def test_wrong_outputs_exit_with_2_and_one_line(names: str, message: str, capsys, monkeypatch, tmp_path: Path) -> None:
    arguments = ["generate", "embedded", "--out", str(tmp_path / "data"), "--outputs", names]
    monkeypatch.setattr(sys, "argv", ["readygo", *arguments])
    with pytest.raises(SystemExit) as exit_info:
        main()
    assert exit_info.value.code == 2
    assert capsys.readouterr().err == f"readygo: {message}\n"
    assert not (tmp_path / "data").exists()


def test_coordinators_settings_are_a_section_of_the_run(tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_text('[coordinator]\nlease_s = 4.0\nrecorders = ["rec0", "rec1"]\n')
    config = load_run_config(path).coordinator
    assert (config.lease_s, config.recorders) == (4.0, ("rec0", "rec1"))
    path.write_text('[coordinator]\nrecorders = ["rec0", "rec0"]\n')
    with pytest.raises(ConfigError, match=r"coordinator: recorders must be different names"):
        load_run_config(path)


def run_config(tmp_path: Path, text: str) -> Path:
    (tmp_path / "run.toml").write_text(text)
    return tmp_path / "run.toml"


def test_what_nobody_names_is_the_policys(tmp_path: Path) -> None:
    camera = CameraConfig(height_px=72, width_px=128, distortion="fisheye", mount_height_m=0.4)
    spec = PolicySpec(robot=RobotConfig(v_max_mps=0.8, camera=camera), sensor=SensorConfig(k1=(0.0, 0.01)))
    base = robot_of_policy(spec)
    whole = load_run_config(None, base=base)
    assert (whole.robot, whole.renderer.sensor) == (spec.robot, spec.sensor)
    other = load_run_config(
        run_config(tmp_path, "[robot]\nv_max_mps = 0.5\n[renderer]\ndetail = 'lod'\n"), base=robot_of_policy(spec)
    )
    assert other.robot == RobotConfig(v_max_mps=0.5, camera=camera)
    assert (other.renderer.sensor, other.renderer.detail) == (spec.sensor, "lod")


def test_camera_and_mix_in_a_file_are_given_whole_and_other_sections_key_by_key(tmp_path: Path) -> None:
    camera, sensor = CameraConfig(height_px=72, width_px=128), SensorConfig(k1=(0.0, 0.01))
    base = robot_of_policy(PolicySpec(robot=RobotConfig(v_max_mps=0.8, camera=camera), sensor=sensor))
    named = load_run_config(
        run_config(tmp_path, "[robot.camera]\nwidth_px = 128\n[renderer.sensor]\nk2 = [0.0, 0.02]\n"), base=base
    )
    mixed = load_run_config(run_config(tmp_path, "[human_planner]\nmix = {doorway = 1.0}\n"))
    assert mixed.human_planner.mix.shares == {"doorway": 1.0}
    assert named.robot == RobotConfig(camera=CameraConfig(width_px=128))
    assert named.renderer.sensor == SensorConfig(k1=(0.0, 0.01), k2=(0.0, 0.02))


def test_setting_that_must_be_an_array_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"renderer\.outputs must be an array, got 0\.5"):
        section_from_mapping(RunConfig, {"renderer": {"outputs": 0.5}})
    with pytest.raises(ConfigError, match=r"^robot: radius_m must be positive"):
        section_from_mapping(RunConfig, {"robot": {"radius_m": -1.0}})


def test_camera_whose_latency_falls_between_pictures_is_refused(tmp_path: Path) -> None:
    text = "[robot.camera]\nlatency_s = 0.1\n[driver]\ncamera_hz = "
    assert load_run_config(run_config(tmp_path, text + "10\n")).driver.image_every(Clock()) == 2
    with pytest.raises(ConfigError, match=r"camera_hz 4: the camera's latency of 0\.1 s must be a multiple"):
        load_run_config(run_config(tmp_path, text + "4\n"))
    with pytest.raises(ConfigError, match="camera_hz must be 20 Hz divided by a whole number, got 6"):
        load_run_config(run_config(tmp_path, "[driver]\ncamera_hz = 6\n"))


@pytest.mark.parametrize("text", [b"a = " + b"[" * 100_000, b"a = " + b"9" * 5000, b"a = '\xff'"])
def test_file_beyond_a_limit_is_refused_in_one_line(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "run.toml").write_bytes(text)
    with pytest.raises(ConfigError, match=r"^Configuration .*run\.toml cannot be read: .*\.$"):
        load_run_config(tmp_path / "run.toml")


def test_sensor_recipe_is_that_of_every_camera_and_keeps_where_each_looks() -> None:
    front = CameraConfig(height_px=72, width_px=128, horizontal_fov_deg=95.0, mount_height_m=0.41, mount_x_m=0.13)
    rear = CameraConfig(height_px=54, width_px=96, distortion="fisheye", k1=0.02, mount_x_m=-0.21)
    base = RunConfig(robot=RobotConfig(camera=front, cameras={"rear": rear}, v_max_mps=0.8))
    phone = load_run_config(None, sensor="sensor_phone_like", base=base)
    plain = load_run_config(None, sensor="off", base=phone)
    for name, before in base.robot.all_cameras.items():
        drawn, ideal = phone.robot.all_cameras[name], plain.robot.all_cameras[name]
        assert (drawn.distortion, drawn.k1) == ("brown_conrady", -0.015)
        assert drawn.exposure_s == pytest.approx((1 / 200 + 1 / 60) / 2)
        for found in (drawn, ideal):
            for key in ("height_px", "width_px", "horizontal_fov_deg", "mount_height_m", "mount_x_m"):
                assert getattr(found, key) == getattr(before, key), (name, key)
        assert (ideal.distortion, ideal.k1, ideal.exposure_s) == (CameraConfig().distortion, 0.0, 0.0)
    assert (phone.renderer.sub_frames, phone.renderer.sensor.k1) == (4, (-0.04, 0.01))
    assert plain.renderer.sensor == SensorConfig()
    assert phone.robot.v_max_mps == 0.8


def test_run_whose_backend_cannot_draw_the_robots_ranges_is_refused(tmp_path: Path) -> None:
    robot = "[robot.camera]\nhorizontal_fov_deg = 90.0\n[robot.ranges]\nhorizontal_fov_deg = [80.0, 100.0]\n"
    path = run_config(tmp_path, robot + '[renderer]\nbackend = "triton"\n')
    check_cameras(load_run_config(path, keys={"renderer": {"backend": "cpu"}}))
    with pytest.raises(ConfigError, match="the backend triton draws one field of view"):
        check_cameras(load_run_config(path))
