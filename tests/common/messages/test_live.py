import dataclasses

import msgpack
import numpy as np
import pytest

from readygo.common.errors import MessageError
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.common.messages.codec import decode, encode
from readygo.common.messages.live import LiveCommit, LiveEvaluation, LiveHealth, LivePlan, LiveWork
from tests.common.messages.examples import message

EPISODE = EpisodeKey(seed=0, split=Split.TRAIN, index=0)


def test_plan_has_a_flag_for_every_pose() -> None:
    way = np.zeros((3, 3), np.float32)
    with pytest.raises(ValueError, match="replanned"):
        LivePlan(
            episode=EPISODE,
            outcome=Outcome.SUCCESS,
            goal_xy_m=(0.0, 0.0),
            robot_xyyaw=way,
            replanned=np.zeros(2, np.bool_),
            humans_xy_m=(),
        )


@pytest.mark.parametrize(
    ("cls", "field"),
    [
        (LiveHealth, "role"),
        (LiveHealth, "name"),
        (LiveHealth, "host"),
        (LiveHealth, "metrics"),
        (LiveWork, "stage"),
        (LiveCommit, "shard"),
        (LiveEvaluation, "task"),
        (LiveEvaluation, "method"),
    ],
)
def test_names_that_steer_a_terminal_are_refused(cls: type, field: str) -> None:
    said = message(cls)
    assert dataclasses.asdict(decode(cls, encode(said))) == dataclasses.asdict(said)
    plain = msgpack.unpackb(encode(said)) | {field: "\x1b]0;title\x07"}
    with pytest.raises(MessageError, match=f"{field} must be at most 200 printable characters"):
        decode(cls, msgpack.packb(plain))


@pytest.mark.parametrize("cls", [LiveCommit, LiveEvaluation])
def test_policies_are_named_by_their_hash(cls: type) -> None:
    for policy in ("", "0a" * 32):
        plain = msgpack.unpackb(encode(message(cls))) | {"policy": policy}
        assert decode(cls, msgpack.packb(plain)).policy == policy
    for policy in ("\x1b]0;title\x07", "0a" * 31, "0A" * 32):
        plain = msgpack.unpackb(encode(message(cls))) | {"policy": policy}
        with pytest.raises(MessageError, match="policy must be empty or 64 hexadecimal digits"):
            decode(cls, msgpack.packb(plain))
