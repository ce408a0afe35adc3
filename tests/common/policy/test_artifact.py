import pytest

from readygo.common.camera import SensorConfig
from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, load_spec, save_spec
from readygo.common.policy.artifact import FIRST_INPUTS, Fusion, MotionInput, PolicyInputs
from readygo.common.robot import CameraConfig, RobotConfig

SENSOR = SensorConfig(k1=(-0.1, 0.1), exposure_s=(0.0, 0.01))
OLD_POLICY = """format = "readygo-policy/1"
frame_spacing_s = 0.5

[robot]
radius_m = 0.25
planning_radius_m = 0.3
height_m = 0.6
v_max_mps = 1.0
w_max_radps = 1.2
a_max_mps2 = 1.0
alpha_max_radps2 = 3.0

[robot.camera]
height_px = 90
width_px = 160
horizontal_fov_deg = 80.0
mount_height_m = 0.4

[training]
episodes = 40
"""


def test_policy_of_before_it_named_lens_and_sensor_still_loads(tmp_path):
    (tmp_path / "policy.toml").write_text(OLD_POLICY)
    spec = load_spec(tmp_path)
    camera = CameraConfig(height_px=90, width_px=160, horizontal_fov_deg=80.0, mount_height_m=0.4)
    assert spec.robot == RobotConfig(camera=camera)
    assert spec.sensor == SensorConfig()
    assert spec.inputs == FIRST_INPUTS
    assert spec.inputs.feature_count == 64


def test_camera_with_given_intrinsics_comes_back(tmp_path):
    focal = {"fx_px": 120.0, "fy_px": 118.0, "cx_px": 131.0, "cy_px": 70.5}
    spec = PolicySpec(robot=RobotConfig(camera=CameraConfig(**focal, distortion="fisheye", k1=0.01, latency_s=0.1)))
    save_spec(spec, tmp_path)
    assert load_spec(tmp_path) == spec
    assert "None" not in (tmp_path / "policy.toml").read_text()


def test_spec_comes_back_as_it_was_written(tmp_path):
    robot = RobotConfig(v_max_mps=0.7, camera=CameraConfig(height_px=90, width_px=160))
    training = {"data_sha256": 'ab"c\\d', "episodes": 40, "config": {"minutes": 1e-5, "live": False}, "seeds": [1, 2]}
    inputs = PolicyInputs(fusion=Fusion.EARLY, latent_count=64, motion=MotionInput.COMMAND, frame_count=5)
    spec = PolicySpec(robot=robot, sensor=SENSOR, frame_spacing_s=0.25, inputs=inputs, training=training)
    save_spec(spec, tmp_path)
    assert load_spec(tmp_path) == spec
    assert [path.name for path in tmp_path.iterdir()] == ["policy.toml"]


def test_missing_folder_says_what_to_give(tmp_path):
    with pytest.raises(PolicyError, match="readygo train"):
        load_spec(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format = ", "no TOML"),
        ('format = "readygo-policy/9"', "readygo-policy/9"),
        ('format = "readygo-policy/1"', "robot"),
        ('format = "readygo-policy/1"\nframe_spacing_s = 0.5\n[robot]\nwheels = 4', "wheels"),
        ('format = "readygo-policy/2"\nframe_spacing_s = 0.5\n[robot]', "inputs"),
        ('format = "readygo-policy/1"\nframe_spacing_s = 0.33\n[robot]', "frame_spacing_s"),
        ('format = "readygo-policy/1"\nframe_spacing_s = inf\n[robot]', "frame_spacing_s"),
        (
            'format = "readygo-policy/2"\nframe_spacing_s = 0.5\n[robot]\n'
            '[inputs]\nfusion = "late"\nlatent_count = inf',
            "cannot be used",
        ),
    ],
)
def test_spec_that_cannot_be_used_is_refused(tmp_path, text, message):
    (tmp_path / "policy.toml").write_text(text)
    with pytest.raises(PolicyError, match=message) as caught:
        load_spec(tmp_path)
    assert "\n" not in str(caught.value)


def test_names_that_toml_must_quote_come_back(tmp_path):
    training = {"data": {"avatars": {"Anna B.": "12", "plain_name-3": "34"}}}
    save_spec(PolicySpec(robot=RobotConfig(), training=training), tmp_path)
    assert load_spec(tmp_path).training == training


@pytest.mark.parametrize("text", [b"a = " + b"[" * 100_000, b"a = " + b"9" * 5000, b"a = '\xff'"])
def test_file_beyond_a_limit_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "policy.toml").write_bytes(text)
    with pytest.raises(PolicyError, match=r"policy\.toml is no TOML file: .*; export the policy again\.$"):
        load_spec(tmp_path)
