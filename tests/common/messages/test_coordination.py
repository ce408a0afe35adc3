import hashlib

import pytest

from readygo.common.errors import MessageError
from readygo.common.messages import (
    AppendReply,
    AppendStatus,
    Blob,
    ClaimReply,
    ClaimStatus,
    Command,
    ControlRequest,
    EpisodeKey,
    FileRef,
    PolicyRef,
    RunSpec,
    Split,
    StatusReply,
    Verdict,
    VerdictStatus,
    decode,
    encode,
)
from readygo.common.messages.stages import EXPERT_LINE, RENDER, Stage

KEY = EpisodeKey(seed=7, split=Split.VAL, index=3)
DIGEST = "0d0b523104236eb124895cf494c0303116ac732cc937b66446fb484626df8075"
"""Of the messages below when their statuses were still strings, and all runs had the same stages."""


def _claim(status: ClaimStatus) -> ClaimReply:
    inputs = (Blob(sha256="a", data=b"x"),)
    return ClaimReply(status=status, episode=KEY, attempt=2, ttl_s=15.0, inputs=inputs, recorder="rec0")


def _spec(**changes: object) -> RunSpec:
    fields = {
        "run": "run-1",
        "scene_path": "s",
        "scene_hash": "0",
        "scene_files": (FileRef(path="p", sha256="b", size=1),),
        "avatars_path": "",
        "avatar_hashes": {"ann": "c"},
        "seed": 7,
        "split": Split.TRAIN,
        "static": False,
        "config": {"renderer": {"labels": True}},
        "metadata": {},
    }
    return RunSpec(**{**fields, **changes})


def _status(**changes: object) -> StatusReply:
    fields = {
        "wanted": 2,
        "committed": 1,
        "samples": 3,
        "waiting": {"render": 1},
        "leased": {},
        "rejected": {"timeout": 1},
        "requeued": 0,
        "cpu_s": {"render": 0.5},
        "finished": False,
    }
    return StatusReply(**{**fields, **changes})


def test_wire_format_of_the_lease_protocol_does_not_change_silently() -> None:
    messages = [
        *(_claim(status) for status in ClaimStatus),
        *(Verdict(status=status) for status in VerdictStatus),
        *(AppendReply(status=status, expected_seq=3, detail="why") for status in AppendStatus),
        *(ControlRequest(command=command) for command in Command),
        _status(),
        _spec(),
    ]
    assert hashlib.sha256(b"".join(map(encode, messages))).hexdigest() == DIGEST


def test_status_of_a_later_version_is_no_message() -> None:
    with pytest.raises(MessageError, match="is no Verdict"):
        decode(Verdict, encode(Verdict(status=VerdictStatus.OK)).replace(b"ok", b"no"))


def test_spec_without_stages_has_those_of_an_expert_among_humans() -> None:
    assert b"stages" not in encode(_spec())
    assert decode(RunSpec, encode(_spec())).stages == EXPERT_LINE


def test_stages_of_another_line_travel_with_the_spec() -> None:
    line = (Stage(name="draw", role="painter"), Stage(name="film", role="camera", needs=("draw",), records=True))
    assert decode(RunSpec, encode(_spec(stages=line))).stages == line


def test_line_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="Exactly the last stage"):
        _spec(stages=(RENDER, *EXPERT_LINE[:3]))


def test_counts_of_kept_episodes_travel_where_there_are_any() -> None:
    assert b"kept" not in encode(_status())
    assert decode(StatusReply, encode(_status(kept={"timeout": 2}))).kept == {"timeout": 2}


def test_policy_travels_with_the_spec_where_there_is_one() -> None:
    assert b"policy" not in encode(_spec())
    policy = PolicyRef(path="p", files=(FileRef(path="policy.toml", sha256="0" * 64, size=3),), mix=0.5)
    assert decode(RunSpec, encode(_spec(policy=policy))).policy == policy


@pytest.mark.parametrize("mix", [-0.01, 1.01, float("nan")])
def test_mix_is_a_share(mix: float) -> None:
    with pytest.raises(ValueError, match=r"mix must be 0\.\.1"):
        PolicyRef(path="p", files=(), mix=mix)
