import dataclasses

import pytest
import torch

from readygo.common.camera import CameraConfig
from readygo.common.errors import DatasetError, PolicyError
from readygo.common.policy import load_policy
from readygo.services.trainer.train import train_policy
from tests.services.trainer.conftest import QUICK, forever, quick


def weights(folder):
    return (folder / "policy.onnx").read_bytes()


def test_policy_learns_what_the_images_tell(source, tmp_path, monkeypatch):
    # Brightness tells v here, so light must not vary.
    monkeypatch.setattr("readygo.services.trainer.views.PHOTOMETRIC", 0.0)
    config = quick(samples=4000, learning_rate=2e-3, ema_decay=0.98)
    metrics = train_policy(source, config, tmp_path)
    assert metrics["without_previous_ratio_w"] < 0.6
    assert metrics["without_previous_ratio_v"] < 0.6


def test_equal_seeds_give_equal_weights(source, tmp_path):
    for name in "ab":
        train_policy(source, QUICK, tmp_path / name)
    train_policy(source, quick(seed=1), tmp_path / "c")
    assert weights(tmp_path / "a") == weights(tmp_path / "b")
    assert weights(tmp_path / "a") != weights(tmp_path / "c")


@pytest.mark.parametrize("step", [1, 13])
def test_interrupted_run_goes_on_as_if_nothing_had_happened(source, tmp_path, monkeypatch, step):
    monkeypatch.setattr("readygo.services.trainer.run.SAVE_EVERY_S", 0.05)
    train_policy(source, QUICK, tmp_path / "whole")

    def interrupt(progress):
        if progress.step == step:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_policy(source, QUICK, tmp_path / "parts", report=interrupt)
    metrics = train_policy(source, QUICK, tmp_path / "parts")
    assert weights(tmp_path / "parts") == weights(tmp_path / "whole")
    assert metrics["steps"] == 20


def test_finished_run_trains_no_further_and_a_larger_budget_goes_on(source, tmp_path):
    first = train_policy(source, QUICK, tmp_path)
    assert train_policy(source, QUICK, tmp_path)["steps"] == first["steps"] == 20
    assert train_policy(source, quick(samples=960), tmp_path)["steps"] == 30


def test_minutes_are_processor_time(source, tmp_path):
    metrics = train_policy(source, dataclasses.replace(forever(QUICK), minutes=0.01), tmp_path)
    assert metrics["elapsed_s"] >= 0.6
    assert metrics["steps"] > 0


def test_folder_of_another_run_or_network_is_refused(make_data, tmp_path):
    train_policy(make_data(), QUICK, tmp_path)
    with pytest.raises(PolicyError, match="training_data"):
        train_policy(make_data(seed=5), QUICK, tmp_path)
    with pytest.raises(PolicyError, match="another learning_rate"):
        train_policy(make_data(), quick(learning_rate=0.1), tmp_path)
    with pytest.raises(PolicyError, match="another fusion"):
        train_policy(make_data(), quick(fusion="early"), tmp_path)


def test_checkpoint_of_another_architecture_is_refused_in_one_line(source, tmp_path):
    train_policy(source, QUICK, tmp_path)
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    state["model"]["head.layer1.weight"] = torch.zeros(3, 3)
    torch.save(state, tmp_path / "checkpoint.pt")
    with pytest.raises(PolicyError, match=r"checkpoint\.pt is damaged, or of another version") as caught:
        train_policy(source, quick(samples=960), tmp_path)
    assert "\n" not in str(caught.value)


def test_images_of_another_size_are_refused(source, tmp_path):
    source.camera = CameraConfig(height_px=32, width_px=48)
    with pytest.raises(DatasetError, match=r"robot\.toml"):
        train_policy(source, QUICK, tmp_path)


def test_data_without_a_robot_are_refused(source, tmp_path):
    source.robot = None
    with pytest.raises(DatasetError, match="which robot"):
        train_policy(source, QUICK, tmp_path)


@pytest.mark.parametrize(
    "network",
    [{"fusion": "early"}, {"output": "bins"}, {"output": "weighed"}, {"motion": "poses", "humans_weight": 0.1}],
)
def test_every_network_can_be_trained_and_loaded(source, tmp_path, network):
    source.has_expert = True
    train_policy(source, quick(samples=96, ahead_s=0.2, **network), tmp_path)
    load_policy(tmp_path)
