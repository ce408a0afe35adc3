"""A message of every class that travels."""

import dataclasses
import typing

import numpy as np

from readygo.common import messages
from readygo.common.messages import (
    EpisodeHeader,
    EpisodeKey,
    FurtherCamera,
    HumanTrajectory,
    Motion,
    Outcome,
    RenderView,
    RobotTrajectory,
    Sample,
    Scenario,
    Split,
)
from readygo.common.messages.live import LivePerception, LivePerson
from readygo.common.messages.samples import HumanLabels

KEY = EpisodeKey(seed=7, split=Split.VAL, index=3)
SHA256 = "0123456789abcdef" * 4


def example(hint: typing.Any) -> typing.Any:
    """A value of a message field's type."""
    origin = typing.get_origin(hint)
    plain = {int: 3, float: 0.5, str: "text", bytes: b"\x00\xff", bool: True}
    if hint in plain:
        return plain[hint]
    if dataclasses.is_dataclass(hint):
        return message(hint)
    if origin is tuple:
        count = len(typing.get_args(hint)) - (typing.get_args(hint)[-1] is Ellipsis)
        return tuple(example(typing.get_args(hint)[0]) for _ in range(count))
    if origin is dict:
        return {"key": example(typing.get_args(hint)[1])}
    if origin is not None and type(None) in typing.get_args(hint):
        return example(typing.get_args(hint)[0])
    if hint is typing.Any:
        return [1, "two"]
    return next(iter(hint))


def message(cls: type) -> typing.Any:
    """A message of this class."""
    arrays = {
        Scenario: lambda: Scenario(
            episode=KEY, start_xyyaw=np.arange(3.0), goal_xy_m=np.ones(2), humans=(message(HumanTrajectory),)
        ),
        HumanTrajectory: lambda: HumanTrajectory(
            avatar="ann", encounter="crossing", speed_mps=1.0, xy_m=np.arange(8.0).reshape(4, 2)
        ),
        Motion: lambda: Motion(root_m=np.ones((2, 3), np.float32), pose_axis_angle=np.zeros((2, 24, 3), np.float32)),
        RobotTrajectory: lambda: RobotTrajectory(
            outcome=Outcome.SUCCESS,
            xyyaw=np.zeros((2, 3)),
            actions=np.ones((2, 2)),
            replanned=np.array([True, False]),
            human_visible=np.array([False, True]),
            human_distance_m=np.array([1.0, np.inf]),
            time_to_collision_s=np.array([np.inf, 2.0]),
            expert_cost=np.zeros(2),
            replan_times_s=np.zeros(1),
        ),
        LivePerception: lambda: LivePerception(
            episode=KEY,
            time_ns=3,
            robot_xyzyaw=(0.5, 0.5, 0.5, 0.5),
            detections=(message(LivePerson),),
            tracks=(message(LivePerson),),
            ray_bearings_rad=np.ones(3, np.float32),
            rays_m=np.ones(3, np.float32),
        ),
        RenderView: lambda: RenderView(people="p", step=4, T_world_camera=np.eye(4)),
        EpisodeHeader: lambda: header(distortion_model="plumb_bob", distortion=(0.1, -0.2, 0.3, 0.4, 0.5)),
        FurtherCamera: lambda: FurtherCamera(
            name="left",
            height_px=24,
            width_px=32,
            K_px=(30.0, 0.0, 16.0, 0.0, 30.0, 12.0, 0.0, 0.0, 1.0),
            distortion_model="kannala_brandt",
            distortion=(0.1, -0.2, 0.3, 0.4),
        ),
        HumanLabels: lambda: HumanLabels(
            joints_m=np.full((24, 3), 0.1, np.float32),
            box=np.arange(7.0),
            footprint_xy_m=np.ones((5, 2), np.float32),
        ),
        messages.Stage: lambda: messages.Stage(name="film", role="camera", records=True),
        messages.RenderReply: lambda: messages.RenderReply(rgb=np.zeros((1, 2, 3, 3), np.uint8)),
    }
    if cls in arrays:
        return arrays[cls]()
    hints = typing.get_type_hints(cls)
    return cls(**{field.name: _field(field.name, hints[field.name]) for field in dataclasses.fields(cls)})


def _field(name: str, hint: typing.Any) -> typing.Any:
    """A value of a message's field; those with these names hold a SHA-256."""
    if name in ("avatar_hashes", "method_hashes"):
        return {"key": SHA256}
    return SHA256 if name in ("sha256", "scene_hash", "policy") and hint is str else example(hint)


MESSAGES = [
    getattr(messages, name)
    for name in messages.__all__
    if isinstance(getattr(messages, name), type) and dataclasses.is_dataclass(getattr(messages, name))
]


def header(**changes: typing.Any) -> EpisodeHeader:
    header = EpisodeHeader(
        episode=KEY,
        sample_count=1,
        goal_xy_m=(1.0, 2.0),
        start_xyyaw=(0.0, 0.0, 0.0),
        avatars=("ann",),
        encounters=("crossing",),
        image_format="jpeg",
        height_px=144,
        width_px=256,
        K_px=(1.0,) * 9,
    )
    return dataclasses.replace(header, **changes)


def sample(**changes: typing.Any) -> Sample:
    sample = Sample(
        seq=0,
        crc32=1,
        time_ns=50_000_000,
        image=b"jpeg",
        action_v_mps=0.5,
        action_w_radps=-0.25,
        goal_xy_robot_m=(1.0, 2.0),
        robot_xyzyaw=(0.0, 1.0, 2.0, 3.0),
        humans_xyzyaw=((4.0, 5.0, 6.0, 7.0),),
        human_distance_m=2.0,
        time_to_collision_s=3.0,
        human_visible=True,
        expert_cost=4.0,
        replanned=False,
    )
    return dataclasses.replace(sample, **changes)
