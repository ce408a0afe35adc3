import dataclasses

import numpy as np
import pytest
import torch

from readygo.common.config import section_to_mapping
from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, load_policy, load_spec, save_spec
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.finetune import load_network, save_network
from readygo.services.trainer.model import PolicyNet

NETWORK = NetworkConfig(output="weighed", widths=(4, 4, 4, 4, 4), motion="poses")


@pytest.fixture
def folder(tmp_path):
    torch.manual_seed(1)
    robot = RobotConfig(v_max_mps=0.7, camera=CameraConfig(height_px=16, width_px=16))
    training = {"seed": 4, "config": {"network": section_to_mapping(NETWORK)}}
    net = PolicyNet(robot, NETWORK, reads_humans=True).eval()
    export_policy(net, PolicySpec(robot=robot, training=training), tmp_path / "policy")
    return tmp_path / "policy"


def decisions(folder):
    policy, rng = load_policy(folder), np.random.default_rng(0)
    memory, images = policy.start(), rng.integers(0, 256, (20, 1, 16, 16, 3), np.uint8)
    commands, goals = rng.uniform(0, 0.7, (20, 1, 2)), rng.uniform(-8, 8, (20, 1, 2))
    rows = zip(images, commands.astype(np.float32), goals.astype(np.float32), strict=True)
    return np.concatenate([policy.step([memory], *row) for row in rows])


def test_policy_that_is_loaded_and_saved_decides_the_same_until_it_is_trained_on(folder, tmp_path):
    net, before = load_network(folder), decisions(folder)
    save_network(net, folder, tmp_path / "same", {})
    assert (tmp_path / "same" / "policy.onnx").read_bytes() == (folder / "policy.onnx").read_bytes()
    net.head.layer3.bias.data.normal_()
    save_network(net, folder, tmp_path / "new", {"by": "hand", "steps": 3})
    assert np.abs(decisions(tmp_path / "new") - before).max() > 1e-2
    spec = load_spec(tmp_path / "new")
    assert spec.training["fine_tuned"] == {"by": "hand", "steps": 3}
    assert spec.training["seed"] == 4
    again = load_network(tmp_path / "new").state_dict()
    assert all(torch.equal(again[name], value) for name, value in net.state_dict().items())


def test_policies_with_an_image_of_the_goal_that_decided_20_times_a_second_are_still_trained_on(tmp_path):
    robot, network = RobotConfig(camera=CameraConfig(height_px=16, width_px=16)), NetworkConfig(goal="both")
    training = {"config": {"network": section_to_mapping(network)}}
    export_policy(PolicyNet(robot, network).eval(), PolicySpec(robot=robot, training=training), tmp_path)
    spec = load_spec(tmp_path)
    save_spec(dataclasses.replace(spec, graph=dataclasses.replace(spec.graph, rate_hz=20.0)), tmp_path)
    save_network(load_network(tmp_path), tmp_path, tmp_path / "new", {})
    assert load_spec(tmp_path / "new").graph.rate_hz is None
    save_spec(dataclasses.replace(spec, graph=dataclasses.replace(spec.graph, rate_hz=10.0)), tmp_path)
    with pytest.raises(PolicyError, match="is not of the network"):
        load_network(tmp_path)


def test_policies_that_are_not_what_they_say_are_refused(folder, tmp_path):
    spec = load_spec(folder)
    with pytest.raises(PolicyError, match="began with"):
        save_network(load_network(folder), folder, folder, {})
    network = section_to_mapping(dataclasses.replace(NETWORK, latent_count=8))
    save_spec(dataclasses.replace(spec, training={"config": {"network": network}}), folder)
    with pytest.raises(PolicyError, match="is not of the network"):
        load_network(folder)
    save_spec(dataclasses.replace(spec, training={}), folder)
    with pytest.raises(PolicyError, match="does not say what network"):
        load_network(folder)
    save_spec(spec, folder)
    (folder / "weights.safetensors").write_bytes(b"no weights")
    with pytest.raises(PolicyError, match=r"weights\.safetensors"):
        load_network(folder)
