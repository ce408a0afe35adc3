import dataclasses
import hashlib

import msgpack
import pytest

from readygo.common.errors import MessageError
from readygo.common.messages import (
    AppendReply,
    AppendStatus,
    Blob,
    BlobRequest,
    ClaimReply,
    ClaimStatus,
    Command,
    ControlRequest,
    DoneRequest,
    DriverKind,
    EpisodeKey,
    FileRef,
    OfferReply,
    Outcome,
    PolicyRef,
    RunSpec,
    Split,
    StatusReply,
    TeacherKind,
    TeacherRef,
    Verdict,
    VerdictStatus,
    decode,
    encode,
)
from readygo.common.messages.live import LiveCommit, LiveEvaluation
from readygo.common.messages.stages import EXPERT_LINE, RENDER, Stage
from tests.common.messages.examples import header

KEY = EpisodeKey(seed=7, split=Split.VAL, index=3)
DIGEST = "72dd964371afe90ac6a9b8b78887a4da1a4b7051cbb8305961cc47021515dae1"
"""Of the messages below when their statuses were still strings, and all runs had the same stages."""


def _claim(status: ClaimStatus) -> ClaimReply:
    inputs = (Blob(sha256="a" * 64, data=b"x"),)
    return ClaimReply(status=status, episode=KEY, attempt=2, ttl_s=15.0, inputs=inputs, recorder="rec0")


def _spec(**changes: object) -> RunSpec:
    fields = {
        "run": "run-1",
        "scene_path": "s",
        "scene_hash": "0" * 64,
        "scene_files": (FileRef(path="p", sha256="b" * 64, size=1),),
        "avatars_path": "",
        "avatar_hashes": {"ann": "c" * 64},
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


def test_teacher_travels_with_the_spec_where_there_is_one() -> None:
    assert b"teacher" not in encode(_spec())
    files = (FileRef(path="state_policy.toml", sha256="0" * 64, size=3),)
    teacher = TeacherRef(path="p", files=files)
    assert decode(RunSpec, encode(_spec(teacher=teacher))).teacher == teacher
    assert teacher.sha256 == teacher.name == PolicyRef(path="", files=files, mix=0.5).sha256


def test_expert_among_tracked_people_travels_as_a_teacher_and_has_no_files() -> None:
    teacher = TeacherRef(path="", files=(), kind=TeacherKind.EXPERT_TRACKED)
    assert decode(RunSpec, encode(_spec(teacher=teacher))).teacher == teacher
    assert teacher.name == "expert-tracked"
    for more in ({"path": "p"}, {"files": (FileRef(path="actor.npz", sha256="0" * 64, size=3),)}):
        with pytest.raises(ValueError, match=r"^A teacher of the kind 'expert-tracked' has no files"):
            dataclasses.replace(teacher, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("mix", [-0.01, 1.01, float("nan")])
def test_mix_is_a_share(mix: float) -> None:
    with pytest.raises(ValueError, match=r"mix must be 0\.\.1"):
        PolicyRef(path="p", files=(), mix=mix)


WRONG = ("", "a", "/etc/cron.d", "../../..", "A" * 64)


@pytest.mark.parametrize("sha256", WRONG)
def test_hash_that_is_none_is_no_message(sha256: str) -> None:
    """The name of a folder or of a file is made of each of these."""
    file = FileRef(path="scene.ply", sha256="b" * 64, size=1)
    good = (_spec(), Blob(sha256="a" * 64), BlobRequest(sha256="a" * 64), file, OfferReply(version=1, sha256="a" * 64))
    for each in good:
        fields = msgpack.unpackb(encode(each))
        name = "scene_hash" if isinstance(each, RunSpec) else "sha256"
        with pytest.raises(MessageError, match=f"is no {type(each).__name__}: {name} must be 64 hexadecimal digits"):
            decode(type(each), msgpack.packb(fields | {name: sha256}))
    with pytest.raises(ValueError, match="avatar_hashes of 'ann' must be 64"):
        _spec(avatar_hashes={"ann": sha256})


@pytest.mark.parametrize("change", [{"path": "/etc/passwd"}, {"path": "../x"}, {"size": -1}, {"size": 2**62}])
def test_file_outside_of_its_bundle_or_of_no_size_is_no_message(change: dict[str, object]) -> None:
    fields = msgpack.unpackb(encode(FileRef(path="scene.ply", sha256="b" * 64, size=1)))
    with pytest.raises(MessageError, match=r"is no FileRef: (path|size) must be"):
        decode(FileRef, msgpack.packb(fields | change))


@pytest.mark.parametrize("policy", WRONG[1:])
def test_policy_of_what_was_recorded_is_a_hash_or_empty(policy: str) -> None:
    done = DoneRequest(recorder="r", index=0, attempt=1, shard="s", sample_count=3)
    ended = {"episode": KEY, "outcome": Outcome.SUCCESS}
    with pytest.raises(ValueError, match="policy must be empty or 64"):
        dataclasses.replace(done, policy=policy)
    with pytest.raises(ValueError, match="policy must be empty or 64"):
        header(policy=policy)
    with pytest.raises(ValueError, match="policy must be empty or 64"):
        LiveCommit(**ended, attempt=1, driver=DriverKind.POLICY, policy=policy, sample_count=1, shard="s")
    with pytest.raises(ValueError, match="policy must be empty or 64"):
        LiveEvaluation(**ended, task="static", method="policy", policy=policy, duration_s=1.0)
