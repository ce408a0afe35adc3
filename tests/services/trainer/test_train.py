import dataclasses

import pytest
import torch

from readygo.common.camera import CameraConfig
from readygo.common.errors import DatasetError, PolicyError
from readygo.common.policy import load_policy
from readygo.services.trainer import TrainConfig, paper_recipe
from readygo.services.trainer.train import train
from tests.services.trainer.conftest import QUICK


def weights(folder):
    return (folder / "encoder.onnx").read_bytes() + (folder / "head.onnx").read_bytes()


def test_policy_learns_what_the_images_tell(source, tmp_path):
    # Brightness tells v here, so light must not vary.
    config = dataclasses.replace(QUICK, epochs=15, learning_rate=2e-3, photometric=0.0, previous_dropout=0.5)
    metrics = train(source, config, tmp_path)
    assert metrics["without_previous_ratio_w"] < 0.6
    assert metrics["without_previous_ratio_v"] < 0.6


def test_checkpoint_of_before_the_camera_was_one_section_is_gone_on_with(source, tmp_path):
    train(source, QUICK, tmp_path)
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    camera = state["identity"]["robot"]["camera"]
    old = ("height_px", "width_px", "horizontal_fov_deg", "mount_height_m")
    state["identity"]["robot"]["camera"] = {name: camera[name] for name in old}
    torch.save(state, tmp_path / "checkpoint.pt")
    assert train(source, dataclasses.replace(QUICK, epochs=3), tmp_path)["steps"] > state["counters"][0]


def test_equal_seeds_give_equal_weights(source, tmp_path):
    for name in ("a", "b"):
        train(source, QUICK, tmp_path / name)
    train(source, dataclasses.replace(QUICK, seed=1), tmp_path / "c")
    assert weights(tmp_path / "a") == weights(tmp_path / "b")
    assert weights(tmp_path / "a") != weights(tmp_path / "c")


def test_interrupted_run_goes_on_as_if_nothing_had_happened(source, tmp_path):
    train(source, QUICK, tmp_path / "whole")

    def interrupt(progress):
        if progress.step == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(source, QUICK, tmp_path / "parts", report=interrupt)
    train(source, QUICK, tmp_path / "parts")
    assert weights(tmp_path / "parts") == weights(tmp_path / "whole")


def test_finished_run_trains_no_further(source, tmp_path):
    first = train(source, QUICK, tmp_path)
    assert train(source, QUICK, tmp_path)["steps"] == first["steps"]


def test_larger_budget_goes_on(source, tmp_path):
    first = train(source, QUICK, tmp_path)
    more = train(source, dataclasses.replace(QUICK, epochs=3), tmp_path)
    assert more["steps"] == 1.5 * first["steps"]


def test_minutes_end_training(source, tmp_path):
    metrics = train(source, dataclasses.replace(QUICK, epochs=None, minutes=0.01), tmp_path)
    assert metrics["elapsed_s"] >= 0.6
    assert metrics["steps"] > 0


def test_folder_of_another_run_is_refused(make_data, tmp_path):
    train(make_data(), QUICK, tmp_path)
    with pytest.raises(PolicyError, match="training data"):
        train(make_data(seed=5), QUICK, tmp_path)
    with pytest.raises(PolicyError, match="learning_rate"):
        train(make_data(), paper_recipe(QUICK), tmp_path)


def test_closed_loop_success_chooses_the_checkpoint(source, tmp_path):
    asked = []

    def evaluate(folder):
        load_policy(folder)
        asked.append(folder)
        return 0.75 if len(asked) == 2 else 0.5

    config = dataclasses.replace(QUICK, epochs=3, rollout_every=1)
    metrics = train(source, config, tmp_path, evaluate=evaluate)
    assert metrics["chosen_step"] == metrics["history"][1]["step"]
    assert len(asked) == len(metrics["history"])
    assert not asked[0].exists()


def test_policy_that_was_never_rolled_out_is_at_the_end(source, tmp_path):
    metrics = train(source, dataclasses.replace(QUICK, rollout_every=100), tmp_path, evaluate=lambda _: 0.5)
    assert metrics["chosen_step"] == metrics["steps"]


def test_images_of_another_size_are_refused(source, tmp_path):
    source.camera = CameraConfig(height_px=32, width_px=48)
    with pytest.raises(DatasetError, match=r"robot\.toml"):
        train(source, QUICK, tmp_path)


def test_data_without_a_robot_are_refused(source, tmp_path):
    source.robot = None
    with pytest.raises(DatasetError, match="which robot"):
        train(source, QUICK, tmp_path)


def test_robots_of_training_and_validation_must_agree(make_data, tmp_path):
    other = make_data(camera=CameraConfig(height_px=32, width_px=48))
    with pytest.raises(DatasetError, match="different robots"):
        train(make_data(), QUICK, tmp_path, validation=other)


def test_frames_within_the_cache_are_decoded_once(source, tmp_path):
    train(source, QUICK, tmp_path / "cached")
    once = source.decoded
    train(source, dataclasses.replace(QUICK, cache_mb=0), tmp_path / "not")
    assert once <= 360
    assert source.decoded > 3 * once


@pytest.mark.slow
def test_four_episodes_can_be_learned_by_heart(make_data, tmp_path):
    source = make_data(episodes=4, samples=100)
    config = TrainConfig(
        epochs=60,
        threads=1,
        batch_size=40,
        validate_every_steps=100,
        previous_dropout=0.0,
        previous_noise=0.0,
        photometric=0.0,
        shift_px=0,
        mirror=0.0,
        yaw_error_rad=0.0,
    )
    metrics = train(source, config, tmp_path, validation=source)
    assert metrics["rmse_v_mps"] < 0.05
    assert metrics["rmse_w_radps"] < 0.05
