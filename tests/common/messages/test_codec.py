import dataclasses
import hashlib
import typing

import numpy as np
import pytest

from readygo.common import messages
from readygo.common.errors import BusError
from readygo.common.messages import (
    AppendRequest,
    Blob,
    ClaimReply,
    EpisodeHeader,
    EpisodeKey,
    EpisodeMotions,
    HumanLabels,
    HumanMotion,
    HumanTrajectory,
    Motion,
    Outcome,
    RenderView,
    RobotPlanRequest,
    RobotTrajectory,
    Sample,
    Scenario,
    Split,
    decode,
    encode,
)

KEY = EpisodeKey(seed=7, split=Split.VAL, index=3)


def _example(hint: typing.Any) -> typing.Any:
    """A value of a message field's type."""
    origin = typing.get_origin(hint)
    plain = {int: 3, float: 0.5, str: "text", bytes: b"\x00\xff", bool: True}
    if hint in plain:
        return plain[hint]
    if dataclasses.is_dataclass(hint):
        return _message(hint)
    if origin is tuple:
        count = len(typing.get_args(hint)) - (typing.get_args(hint)[-1] is Ellipsis)
        return tuple(_example(typing.get_args(hint)[0]) for _ in range(count))
    if origin is dict:
        return {"key": _example(typing.get_args(hint)[1])}
    if origin is not None and type(None) in typing.get_args(hint):
        return _example(typing.get_args(hint)[0])
    if hint is typing.Any:
        return [1, "two"]
    return next(iter(hint))


def _message(cls: type) -> typing.Any:
    arrays = {
        Scenario: lambda: Scenario(
            episode=KEY, start_xyyaw=np.arange(3.0), goal_xy_m=np.ones(2), humans=(_message(HumanTrajectory),)
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
        RenderView: lambda: RenderView(people="p", step=4, T_world_camera=np.eye(4)),
        EpisodeHeader: lambda: _header(distortion_model="plumb_bob", distortion=(0.1, -0.2, 0.3, 0.4, 0.5)),
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
    return cls(**{field.name: _example(hints[field.name]) for field in dataclasses.fields(cls)})


MESSAGES = [
    getattr(messages, name)
    for name in messages.__all__
    if isinstance(getattr(messages, name), type) and dataclasses.is_dataclass(getattr(messages, name))
]


def _plain(value: typing.Any) -> typing.Any:
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.tolist()
    if dataclasses.is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    return [_plain(item) for item in value] if isinstance(value, (tuple, list)) else value


@pytest.mark.parametrize("cls", MESSAGES, ids=lambda cls: cls.__name__)
def test_every_message_round_trips(cls: type) -> None:
    message = _message(cls)
    assert _plain(decode(cls, encode(message))) == _plain(message)


def _header(**changes: typing.Any) -> EpisodeHeader:
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


def _sample(**changes: typing.Any) -> Sample:
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


OLD_DIGEST = "d5622e95c6c006518bface14e4fb73ba1b0a132ecee91b14784b3e8e1dd2efc7"
"""Of an append whose messages had neither outputs nor distortion nor labels yet."""
LABELS_DIGEST = "6849e2472c6eb5428766d83d6fa038fd5528e54a4e1849a9cce5981f8839c5cd"
NEW_DIGEST = "4421117732129706089e16af539a3501bf68b869fcc5d4025958f5b714d0a852"


@pytest.mark.parametrize(
    ("header", "sample", "want"),
    [
        (_header(), _sample(), OLD_DIGEST),
        (
            _header(distortion_model="kannala_brandt", distortion=(0.1, 0.2, 0.3, 0.4)),
            _sample(outputs={"depth": b"png16", "mask": b"png8"}),
            NEW_DIGEST,
        ),
        (_header(labels=True), _sample(labels=(_message(HumanLabels),)), LABELS_DIGEST),
    ],
    ids=["plain", "outputs", "labels"],
)
def test_wire_format_of_an_append_does_not_change_silently(header, sample, want) -> None:
    request = AppendRequest(attempt=1, header=header, first_seq=0, samples=(sample,), last=True)
    digest = hashlib.sha256(encode(request)).hexdigest()
    assert digest == want, f"the wire format changed: {digest}"


def test_message_without_the_new_fields_takes_their_defaults() -> None:
    request = AppendRequest(attempt=1, header=_header(), first_seq=0, samples=(_sample(),), last=True)
    assert b"outputs" not in encode(request)
    assert b"distortion" not in encode(request)
    assert b"labels" not in encode(request)
    assert decode(AppendRequest, encode(request)) == request


def test_missing_new_field_takes_its_default() -> None:
    old = encode(Blob(sha256="a"))
    assert decode(Blob, old.replace(b"\xa4data\xc4\x00", b"").replace(b"\x82", b"\x81", 1)).data == b""


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x93\x01\x02\x03", b"\x81\xa6status"])
def test_damaged_payload_is_a_bus_error(payload: bytes) -> None:
    with pytest.raises(BusError, match="is no ClaimReply"):
        decode(ClaimReply, payload)


def test_nested_motions_survive_in_requests() -> None:
    motions = EpisodeMotions(humans=(HumanMotion(avatar="ann", motion=_message(Motion)),))
    request = RobotPlanRequest(scenario=_message(Scenario), motions=motions)
    back = decode(RobotPlanRequest, encode(request))
    np.testing.assert_array_equal(back.motions.humans[0].motion.root_m, np.ones((2, 3), np.float32))
