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
from readygo.common.policy.graph import Given
from readygo.common.policy.sight import robot_sight
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.services.trainer import TrainConfig, with_overrides
from readygo.services.trainer.episodes import TrainingEpisode
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.model import PolicyNet
from readygo.services.trainer.objective import Objective
from readygo.services.trainer.parts import EpisodePart, timing_of

STEPS = 40
ONE_ROBOT = RobotRanges()


GOAL = np.random.default_rng(5).integers(0, 256, (48, 64, 3), np.uint8)
"""What is seen at the goal."""


def png(picture):
    return cv2.imencode(".png", picture[:, :, ::-1])[1].tobytes()


def recorded(robot, images=("rgb",), drawn=()):
    """An episode of random pictures and commands, kept without loss."""
    rng = np.random.default_rng(1)
    camera, walk = robot.camera, np.cumsum(rng.normal(0, 0.1, (STEPS, 2)), axis=0)
    pictures = rng.integers(0, 256, (STEPS, camera.height_px, camera.width_px, 3), np.uint8)
    commands = np.clip(walk + np.array([0.5, 0.0]), (0, -robot.w_max_radps), (robot.v_max_mps, robot.w_max_radps))
    episode = TrainingEpisode(
        name="e",
        images=tuple(map(png, pictures)),
        actions=commands.astype(np.float32),
        goals_xy_m=rng.uniform(-12, 12, (STEPS, 2)).astype(np.float32),
        xyyaw=np.zeros((STEPS, 3)),
        drawn=dict(drawn),
    )
    if images == ("rgb",):
        return pictures, dataclasses.replace(episode, outputs={"goal_image": (png(GOAL),)})
    drawn, outputs = {"rgb": pictures}, {}
    for name in images[1:]:
        if name.endswith("rgb"):
            drawn[name] = rng.integers(0, 256, pictures.shape, np.uint8)
            outputs[name] = tuple(map(png, drawn[name]))
            continue
        depths_m = rng.uniform(0.0, 14.0, pictures.shape[:3]).round(3).astype(np.float32)
        outputs[name] = tuple(encode_output(Images(rgb=GOAL, depth_m=depth_m), "depth") for depth_m in depths_m)
        drawn[name] = [decode_output("depth", file) for file in outputs[name]]
    seen = [
        robot_sight({name: shown[step] for name, shown in drawn.items()}, images, robot, "e", step)
        for step in range(STEPS)
    ]
    return np.stack(seen), dataclasses.replace(episode, outputs=outputs)


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
    own = ["window", "command", "goal", "latents"] if fusion == "late" else ["command", "goal"]
    assert input_names(tmp_path) == ["rgb", "depth", *own]


@pytest.mark.parametrize("output", ["regression", "weighed"])
@pytest.mark.parametrize("motion", ["poses", "command"])
def test_policy_for_several_robots_drives_each_as_the_network_that_was_trained(tmp_path, output, motion):
    ranges = RobotRanges(mount_height_m=(0.2, 0.8), v_max_mps=(0.4, 1.4), w_max_radps=(0.6, 2.0))
    ways = []
    for name, share in (("a", 0.2), ("b", 0.9)):
        drawn = {field: ends[0] + (ends[1] - ends[0]) * share for field, ends in ranges.items() if ends}
        ways.append(check_same_drive(tmp_path / name, ("rgb",), ranges, drawn, output=output, motion=motion))
    assert np.abs(ways[0] - ways[1]).max() > 0.01
    own = "motion" if motion == "poses" else "command"
    assert input_names(tmp_path / "a") == ["rgb", "window", own, "goal", "robot", "latents"]
    assert load_policy(tmp_path / "a").spec.robot.ranges == ranges


@pytest.mark.parametrize("fusion", ["late", "early"])
def test_policy_of_two_cameras_drives_as_the_network_that_was_trained(tmp_path, fusion):
    check_same_drive(tmp_path, ("rgb", "depth", "left.rgb", "left.depth"), fusion=fusion)
    assert input_names(tmp_path)[:4] == ["rgb", "depth", "left.rgb", "left.depth"]


@pytest.mark.parametrize("goal", ["image", "both"])
@pytest.mark.parametrize("motion", ["poses", "command"])
def test_policy_that_sees_its_goal_drives_as_the_network_that_was_trained(tmp_path, goal, motion):
    check_same_drive(tmp_path, ("rgb",), goal=goal, motion=motion, output="weighed")
    assert load_policy(tmp_path).spec.wants_goal_image
    point = ["goal"] if goal == "both" else []
    own = "motion" if motion == "poses" else "command"
    assert input_names(tmp_path) == ["rgb", "window", "goal_frame", own, *point, "latents"]


def test_policy_for_several_robots_that_sees_its_goal_drives_as_the_network_that_was_trained(tmp_path):
    ranges = RobotRanges(v_max_mps=(0.4, 1.4), w_max_radps=(0.6, 2.0))
    drawn = {"v_max_mps": 1.2, "w_max_radps": 0.7}
    for goal in ("image", "both"):
        check_same_drive(tmp_path, ("rgb",), ranges, drawn, goal=goal, motion="command")
        assert load_policy(tmp_path).spec.graph.inputs["robot"] == Given.ROBOT


@pytest.mark.parametrize("fusion", ["late", "early"])
def test_policy_that_remembers_drives_as_the_network_that_was_trained(tmp_path, fusion):
    settings = {"fusion": fusion, "motion": "poses", "output": "weighed", "memory_count": 6}
    way = check_same_drive(tmp_path, ("rgb",), step_count=5, **settings)
    graph = load_policy(tmp_path).spec.graph
    assert (graph.state, graph.rate_hz) == ({"memory": "memory_next"}, 4.0)
    assert len(np.unique(way[:, 1])) > 3


def check_same_drive(folder, images, ranges=ONE_ROBOT, drawn=(), step_count=1, **settings):
    """Commands of the network at every `step_count`-th step, with which the policy's are compared."""
    noise = {"depth_noise": 0.003, "depth_lost": 0.1} if "depth" in images else {}
    camera = CameraConfig(height_px=48, width_px=64, latency_s=0.1, **noise)
    left = dataclasses.replace(camera, mount_yaw_deg=60.0, depth_max_m=5.0)
    cameras = {} if ranges.varies else {"left": left}
    limits = {"v_max_mps": 0.8, "v_min_mps": -0.2 if ranges.varies else 0.0, "w_max_radps": 0.9}
    robot = RobotConfig(**limits, camera=camera, cameras=cameras, ranges=ranges)
    config = with_overrides(
        TrainConfig(cache_mb=1),
        **{"pooled_height_px": 24, "frame_spacing_s": 0.25, "images": images, **settings},
    )
    pictures, episode = recorded(robot, images, drawn)
    part = EpisodePart(robot, config, 1.0)
    part.reservoir.add(episode)
    model = network(robot, config)
    objective = Objective(robot, config, timing_of(robot, config), torch.float32)
    with torch.inference_mode():
        shown = objective.plain(part.table, part.frames, np.arange(0, STEPS, step_count))
        expected = model.clip(model.decide(objective.answers(model, shown)[0]), shown.traits).numpy()
    export_policy(model, PolicySpec(robot=robot, frame_spacing_s=0.25), folder)
    policy = load_policy(folder)
    memory, driven = policy.start(robot.with_values(dict(drawn))), []
    memory.show_goal(GOAL)
    for step in range(STEPS):
        late = pictures[max(step - 2, 0)][None]
        previous = episode.actions[step - 1 : step] if step else np.zeros((1, 2), np.float32)
        driven.append(policy.step([memory], late, previous, episode.goals_xy_m[step : step + 1])[0])
    assert np.abs(np.array(driven[::step_count]) - expected).max() < 1e-4
    assert np.std(expected, axis=0).max() > 1e-3
    return expected


def test_spec_names_what_the_network_takes(tmp_path):
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    config = with_overrides(TrainConfig(), fusion="early", frame_count=4, motion="poses")
    export_policy(network(robot, config), PolicySpec(robot=robot), tmp_path)
    graph = load_policy(tmp_path).spec.graph
    assert (graph.inputs, graph.cache, graph.frame_count) == (
        {"rgb": "rgb", "motion": "motion", "goal": "goal"},
        {},
        4,
    )


def input_names(folder):
    return [item.name for item in onnx.load(folder / "policy.onnx").graph.input]
