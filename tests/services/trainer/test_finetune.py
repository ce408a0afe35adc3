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
from readygo.services.trainer.finetune import load_head, save_head
from readygo.services.trainer.model import PolicyNet

NETWORK = NetworkConfig(output="weighed", widths=(4, 4, 4, 4, 4), motion="poses")


@pytest.fixture
def folder(tmp_path):
    torch.manual_seed(1)
    robot = RobotConfig(v_max_mps=0.7, camera=CameraConfig(height_px=16, width_px=16))
    training = {"seed": 4, "config": {"network": section_to_mapping(NETWORK)}}
    export_policy(PolicyNet(robot, NETWORK).eval(), PolicySpec(robot=robot, training=training), tmp_path / "policy")
    return tmp_path / "policy"


def answers(net, features):
    width = net.inputs.latents_width
    with torch.inference_mode():
        found = torch.from_numpy(features)
        raw = net.act(found[:, :width], net.normalise_motion(found[:, width:-2]), found[:, -2:])
        return net.clip(net.decide(raw)).numpy()


def test_head_answers_as_the_policy_does_before_and_after_training(folder, tmp_path):
    net, count = load_head(folder), load_policy(folder).spec.inputs.feature_count
    features = np.random.default_rng(0).normal(size=(20, count)).astype(np.float32)
    width = net.inputs.latents_width
    parts = features[:, :width], features[:, width:-2], features[:, -2:]
    before = answers(net, features)
    assert np.abs(load_policy(folder).act(*parts) - before).max() < 1e-5
    net.head.layer3.bias.data.normal_()
    save_head(net, folder, tmp_path / "new", {"by": "hand", "steps": 3})
    after = load_policy(tmp_path / "new")
    assert np.abs(after.act(*parts) - answers(net, features)).max() < 1e-5
    assert np.abs(answers(net, features) - before).max() > 1e-2
    assert after.spec.training["fine_tuned"] == {"by": "hand", "steps": 3}
    assert after.spec.training["seed"] == 4
    assert (tmp_path / "new" / "encoder.onnx").read_bytes() == (folder / "encoder.onnx").read_bytes()


def test_policies_that_are_not_what_they_say_are_refused(folder, tmp_path):
    spec = load_spec(folder)
    with pytest.raises(PolicyError, match="began with"):
        save_head(load_head(folder), folder, folder, {})
    network = section_to_mapping(dataclasses.replace(NETWORK, latent_count=8))
    save_spec(dataclasses.replace(spec, training={"config": {"network": network}}), folder)
    with pytest.raises(PolicyError, match="is not the network"):
        load_head(folder)
    save_spec(dataclasses.replace(spec, training={}), folder)
    with pytest.raises(PolicyError, match="does not say what network"):
        load_head(folder)
    save_spec(spec, folder)
    (folder / "head.onnx").write_bytes(b"no graph")
    with pytest.raises(PolicyError, match=r"head\.onnx"):
        load_head(folder)
