import pytest

from readygo.common.camera import SensorConfig
from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, load_spec, save_spec
from readygo.common.policy.graph import GraphSpec
from readygo.common.robot import CameraConfig, RobotConfig

FORMAT, GRAPH = 'format = "readygo-policy/5"', 'graph.inputs.image = "rgb"'
SENSOR = SensorConfig(k1=(-0.1, 0.1), exposure_s=(0.0, 0.01))


def test_camera_with_given_intrinsics_comes_back(tmp_path):
    focal = {"fx_px": 120.0, "fy_px": 118.0, "cx_px": 131.0, "cy_px": 70.5}
    spec = PolicySpec(robot=RobotConfig(camera=CameraConfig(**focal, distortion="fisheye", k1=0.01, latency_s=0.1)))
    save_spec(spec, tmp_path)
    assert load_spec(tmp_path) == spec
    assert "None" not in (tmp_path / "policy.toml").read_text()


def test_spec_comes_back_as_it_was_written(tmp_path):
    robot = RobotConfig(v_max_mps=0.7, camera=CameraConfig(height_px=90, width_px=160))
    training = {"data_sha256": 'ab"c\\d', "episodes": 40, "config": {"minutes": 1e-5, "live": False}, "seeds": [1, 2]}
    graph = GraphSpec(inputs={"x": "rgb", "go": "goal"}, state={"h": "h2"}, cache={}, rate_hz=5.0, frame_count=5)
    spec = PolicySpec(robot=robot, sensor=SENSOR, frame_spacing_s=0.25, graph=graph, training=training)
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
        (f"{FORMAT}", "robot"),
        (f"{FORMAT}\nframe_spacing_s = 0.5\n[robot]\nwheels = 4", "wheels"),
        (f"{FORMAT}\nframe_spacing_s = 0.5\n[robot]", "graph"),
        (f"{FORMAT}\nframe_spacing_s = 0.5\ngraph = 3\n[robot]", "cannot be used"),
        (f"{FORMAT}\nframe_spacing_s = 0.5\n[robot]\n[graph]\ninputs = 3", "cannot be used"),
        (f"{FORMAT}\nframe_spacing_s = 0.33\n{GRAPH}\n[robot]", "frame_spacing_s"),
        (f"{FORMAT}\nframe_spacing_s = inf\n{GRAPH}\n[robot]", "frame_spacing_s"),
        (f"{FORMAT}\nframe_spacing_s = 0.5\n[robot]\n[graph]\nframe_count = inf", "cannot be used"),
    ],
)
def test_spec_that_cannot_be_used_is_refused(tmp_path, text, message):
    (tmp_path / "policy.toml").write_text(text)
    with pytest.raises(PolicyError, match=message) as caught:
        load_spec(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("version", [1, 2, 3, 4, 9])
def test_policy_of_another_format_is_refused_with_the_way_to_export_it_again(tmp_path, version):
    (tmp_path / "policy.toml").write_text(f'format = "readygo-policy/{version}"\n')
    with pytest.raises(PolicyError, match=f"readygo-policy/{version}.* exports it from its checkpoint") as caught:
        load_spec(tmp_path)
    assert "\n" not in str(caught.value)


def test_names_that_toml_must_quote_come_back(tmp_path):
    training = {"data": {"avatars": {"Anna B.": "12", "plain_name-3": "34"}}, "note": "a\x01b\n", "runs": [{"k": 1}]}
    save_spec(PolicySpec(robot=RobotConfig(), training=training), tmp_path)
    assert load_spec(tmp_path).training == training


@pytest.mark.parametrize("text", [b"a = " + b"[" * 100_000, b"a = " + b"9" * 5000, b"a = '\xff'"])
def test_file_beyond_a_limit_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "policy.toml").write_bytes(text)
    with pytest.raises(PolicyError, match=r"policy\.toml is no TOML file: .*; export the policy again\.$"):
        load_spec(tmp_path)
