import pytest

from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, load_spec, save_spec
from readygo.common.robot import CameraConfig, RobotConfig


def test_spec_comes_back_as_it_was_written(tmp_path):
    robot = RobotConfig(v_max_mps=0.7, camera=CameraConfig(height_px=90, width_px=160))
    training = {"data_sha256": 'ab"c\\d', "episodes": 40, "config": {"minutes": 1e-5, "live": False}, "seeds": [1, 2]}
    spec = PolicySpec(robot=robot, frame_spacing_s=0.25, training=training)
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
        ('format = "readygo-policy/1"\nframe_spacing_s = 0.33\n[robot]', "frame_spacing_s"),
    ],
)
def test_spec_that_cannot_be_used_is_refused(tmp_path, text, message):
    (tmp_path / "policy.toml").write_text(text)
    with pytest.raises(PolicyError, match=message) as caught:
        load_spec(tmp_path)
    assert "\n" not in str(caught.value)
