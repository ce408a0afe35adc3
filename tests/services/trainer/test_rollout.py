"""The exported policy, step by step, against the trainer's own network on the same episode."""

import dataclasses

import cv2
import numpy as np
import onnx
import pytest
import torch
from torch import nn

from readygo.common.images.files import decode_output, encode_output
from readygo.common.images.images import Images
from readygo.common.policy import PolicySpec, load_policy
from readygo.common.policy.sight import camera_sight
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer import TrainConfig, with_overrides
from readygo.services.trainer.episodes import Episode
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.model import PolicyNet
from readygo.services.trainer.objective import Objective
from readygo.services.trainer.parts import Part, timing_of

STEPS = 40


def recorded(robot, images=("rgb",)):
    """An episode of random pictures and commands, kept without loss."""
    rng = np.random.default_rng(1)
    camera, walk = robot.camera, np.cumsum(rng.normal(0, 0.1, (STEPS, 2)), axis=0)
    pictures = rng.integers(0, 256, (STEPS, camera.height_px, camera.width_px, 3), np.uint8)
    commands = np.clip(walk + np.array([0.5, 0.0]), (0, -robot.w_max_radps), (robot.v_max_mps, robot.w_max_radps))
    episode = Episode(
        name="e",
        images=tuple(cv2.imencode(".png", picture[:, :, ::-1])[1].tobytes() for picture in pictures),
        actions=commands.astype(np.float32),
        goals_xy_m=rng.uniform(-12, 12, (STEPS, 2)).astype(np.float32),
        xyyaw=np.zeros((STEPS, 3)),
    )
    if "depth" not in images:
        return pictures, episode
    depths_m = rng.uniform(0.0, 14.0, pictures.shape[:3]).round(3).astype(np.float32)
    files = tuple(encode_output(Images(rgb=pictures[0], depth_m=depth_m), "depth") for depth_m in depths_m)
    seen = [
        camera_sight(rgb, decode_output("depth", file), images, camera, "e", step)
        for step, (rgb, file) in enumerate(zip(pictures, files, strict=True))
    ]
    return np.stack(seen), dataclasses.replace(episode, outputs={"depth": files})


def network(robot, config):
    """A network whose normalisations have seen data."""
    torch.manual_seed(3)
    model = PolicyNet(robot, config.network)
    for module in model.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.running_mean.normal_(0, 0.3)
            module.running_var.uniform_(0.3, 2.0)
    model.head.layer3.weight.data.mul_(6)
    return model.eval()


@pytest.mark.parametrize("output", ["regression", "bins", "weighed"])
@pytest.mark.parametrize(("fusion", "frame_count"), [("late", 3), ("late", 5), ("early", 3), ("early", 2)])
@pytest.mark.parametrize("motion", ["poses", "command"])
def test_exported_policy_drives_as_the_network_that_was_trained(tmp_path, output, fusion, frame_count, motion):
    check_same_drive(tmp_path, ("rgb",), output=output, fusion=fusion, frame_count=frame_count, motion=motion)


@pytest.mark.parametrize(("fusion", "pooled_height_px"), [("late", 24), ("early", 24), ("early", 0)])
def test_policy_that_sees_depths_drives_as_the_network_that_was_trained(tmp_path, fusion, pooled_height_px):
    check_same_drive(tmp_path, ("rgb", "depth"), fusion=fusion, pooled_height_px=pooled_height_px)
    encoder = onnx.load(tmp_path / "encoder.onnx")
    assert [item.name for item in encoder.graph.input] == ["image", "depth"]


def check_same_drive(folder, images, **settings):
    noise = {"depth_noise": 0.003, "depth_lost": 0.1} if "depth" in images else {}
    camera = CameraConfig(height_px=48, width_px=64, latency_s=0.1, **noise)
    robot = RobotConfig(v_max_mps=0.8, w_max_radps=0.9, camera=camera)
    config = with_overrides(
        TrainConfig(cache_mb=1),
        **{"pooled_height_px": 24, "frame_spacing_s": 0.25, "images": images, **settings},
    )
    pictures, episode = recorded(robot, images)
    part = Part(robot, config, 1.0)
    part.reservoir.add(episode)
    model = network(robot, config)
    objective = Objective(robot, config, timing_of(robot, config), torch.float32)
    with torch.inference_mode():
        shown = objective.plain(part.table, part.frames, np.arange(STEPS))
        expected = model.clip(model.decide(objective.answers(model, shown)[0])).numpy()
    export_policy(model, PolicySpec(robot=robot, frame_spacing_s=0.25), folder)
    policy = load_policy(folder)
    memory, driven = policy.start(), []
    for step in range(STEPS):
        late = pictures[max(step - 2, 0)][None]
        previous = episode.actions[step - 1 : step] if step else np.zeros((1, 2), np.float32)
        driven.append(policy.step([memory], late, previous, episode.goals_xy_m[step : step + 1])[0])
    assert np.abs(np.array(driven) - expected).max() < 1e-4
    assert np.std(expected, axis=0).max() > 1e-3


def test_spec_names_what_the_network_takes(tmp_path):
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    config = with_overrides(TrainConfig(), fusion="early", latent_count=7, motion="poses")
    export_policy(network(robot, config), dataclasses.replace(PolicySpec(robot=robot)), tmp_path)
    inputs = load_policy(tmp_path).spec.inputs
    assert (inputs.fusion.value, inputs.latent_count, inputs.motion.value, inputs.feature_count) == (
        "early",
        7,
        "poses",
        17,
    )
