"""What an episode's hash covers, wherever a shard has it."""

import dataclasses

import pytest

from readygo.common.dataset import encode_episode, read_chunk, schemas
from readygo.common.dataset.canonical import canonical_parts, canonical_sha256, is_canonical
from readygo.common.dataset.chunk import EpisodeChunk, canonical
from readygo.common.dataset.records import Message, iter_messages
from readygo.common.dataset.stage import Scenery
from readygo.common.errors import DatasetError
from readygo.common.messages import DriverKind, Outcome
from tests.common.dataset.episodes import ROBOT, make_episode

STARTS_NS = (0, 1, 7_000_000_000, 123_456_789_012_345)


def episode(index: int = 3, **changes) -> EpisodeChunk:
    header, samples = make_episode(index, 5, outputs=("depth", "mask"), labels=True, **changes)
    asked = [dataclasses.replace(sample, expert_commands=((0.5, 0.25), (0.5, 0.0))) for sample in samples]
    return encode_episode(header, 2, asked)


def messages_of(view: memoryview) -> list[Message]:
    return list(iter_messages(view, 0, len(view)))


@pytest.mark.parametrize("start_ns", STARTS_NS)
def test_an_episode_has_the_same_hash_whenever_it_begins(start_ns) -> None:
    plain = episode(outcome=Outcome.TIMEOUT, driver=DriverKind.POLICY)
    staged = Scenery(robot=ROBOT).stage_episode(plain, start_ns, with_map=False)
    assert staged.start_time_ns == start_ns
    assert read_chunk(staged.data).sha256 == plain.sha256
    assert canonical(staged).data == plain.data


@pytest.mark.parametrize("cx_px", [16.0, 15.5, 0.3, 321.947_012_3, 2047.1])
def test_intrinsics_survive_the_way_to_ros_and_back(cx_px) -> None:
    K_px = (16.0, 0.0, cx_px, 0.0, 16.0, 12.25, 0.0, 0.0, 1.0)
    plain = episode(K_px=K_px)
    staged = Scenery().stage_episode(plain, 5, with_map=False)
    view = memoryview(staged.data)
    (found,) = [m for m in messages_of(view) if m.channel == schemas.ROS_CALIBRATION.number]
    calibration = schemas.ROS_CALIBRATION.message.FromString(view[found.body : found.end])
    assert (calibration.K[2], calibration.K[5]) == (cx_px - 0.5, 11.75)
    assert (calibration.P[2], calibration.P[6]) == (cx_px - 0.5, 11.75)
    assert staged.K_px == K_px
    assert canonical(staged).data == plain.data


def test_canonical_episodes_are_hashed_as_they_are() -> None:
    plain = episode()
    assert is_canonical(messages_of(memoryview(plain.data)))
    assert canonical(plain) is plain


def test_what_viewers_need_is_not_hashed() -> None:
    plain = episode()
    bare, furnished = (Scenery(robot=robot).stage_episode(plain, 0, with_map=False) for robot in (None, ROBOT))
    assert bare.data != furnished.data
    assert {read_chunk(chunk.data).sha256 for chunk in (bare, furnished)} == {plain.sha256}


def test_a_time_that_is_moved_alone_is_noticed() -> None:
    staged = Scenery().stage_episode(episode(), 9_000_000_000, with_map=False)
    data = bytearray(staged.data)
    (pose,) = [m for m in messages_of(memoryview(staged.data)) if (m.channel, m.sequence) == (4, 2)]
    stamp = schemas.ROBOT_POSE.message.FromString(bytes(data[pose.body : pose.end]))
    stamp.timestamp.nanos += 1
    payload = stamp.SerializeToString(deterministic=True)
    assert len(payload) == pose.end - pose.body
    data[pose.body : pose.end] = payload
    with pytest.raises(DatasetError, match="does not match the SHA-256"):
        read_chunk(bytes(data))


def test_messages_that_cannot_be_read_are_named_so() -> None:
    staged = Scenery().stage_episode(episode(), 9_000_000_000, with_map=False)
    view = memoryview(bytearray(staged.data))
    messages = messages_of(view)
    (pose,) = [m for m in messages if (m.channel, m.sequence) == (4, 2)]
    view[pose.body : pose.end] = b"\xff" * (pose.end - pose.body)
    with pytest.raises(DatasetError, match="a message of an episode cannot be read"):
        canonical_sha256(view, messages, 3)


def test_an_index_beyond_all_times_is_refused() -> None:
    view = memoryview(Scenery().stage_episode(episode(), 9_000_000_000, with_map=False).data)
    with pytest.raises(DatasetError, match="cannot be read"):
        list(canonical_parts(view, messages_of(view), 2**63))
