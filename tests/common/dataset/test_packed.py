"""Messages made by hand, beside those of the protobuf library."""

import dataclasses
import math

import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame

from readygo.common.dataset import columns, packed, schemas
from readygo.common.dataset.poses import pose_of
from tests.common.dataset.episodes import make_episode, with_goal_image, with_left_camera
from tests.crooked import crooked_episode


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3, -3.0, math.pi])
@pytest.mark.parametrize("z_m", [0.0, -0.1])
def test_a_samples_poses_and_image_are_those_of_the_library(yaw_rad: float, z_m: float) -> None:
    header, (sample, *_) = make_episode(0)
    humans = ((1.0, 0.0, z_m, yaw_rad), (0.0, 0.0, 0.0, 0.0))
    sample = dataclasses.replace(sample, humans_xyzyaw=humans)
    stamp, stamps = schemas.timestamp(1_500_000_000), columns.stamps(np.array([1_500_000_000], dtype=np.uint64))
    by_channel = {each.channel: columns.rows_of(each.at(stamps)) for each in packed.messages([sample], header)}
    poses = PosesInFrame(timestamp=stamp, frame_id="world", poses=[pose_of(*human) for human in humans])
    image = CompressedImage(timestamp=stamp, frame_id="camera", data=sample.image, format=header.image_format)
    assert by_channel[schemas.HUMANS] == [schemas.serialize(poses)]
    assert by_channel[schemas.IMAGE] == [schemas.serialize(image)]


def test_people_may_come_and_go() -> None:
    header, samples = make_episode(0, 3)
    somebody, other = (1.0, 2.0, 0.0, 0.5), (3.0, 4.0, 0.5, 0.0)
    crowds = [(), (somebody, other), (other,)]
    samples = [dataclasses.replace(sample, humans_xyzyaw=crowd) for sample, crowd in zip(samples, crowds, strict=True)]
    (humans,) = (each for each in packed.messages(samples, header) if each.channel is schemas.HUMANS)
    assert columns.rows_of(humans.groups[0]) == [
        schemas.serialize(PosesInFrame(frame_id="world", poses=[pose_of(*human) for human in crowd]))
        for crowd in crowds
    ]


def test_a_time_is_the_first_field_of_a_message() -> None:
    stamp = packed.stamp(1_500_000_000)
    assert stamp == schemas.serialize(CompressedImage(timestamp=schemas.timestamp(1_500_000_000)))


def test_messages_come_in_the_order_of_their_channels_with_all_that_there_may_be() -> None:
    """The order is part of what the hash of an episode covers."""
    changes = {"drawn": {"v_max_mps": 0.7}, "labels": True, "avatars": ("ann",)}
    header, samples = make_episode(3, 3, outputs=("depth",), **changes)
    header, samples = with_goal_image(*with_left_camera(header, samples))
    asked = [dataclasses.replace(sample, expert_commands=((0.5, 0.25), (0.5, 0.0))) for sample in samples]
    topics = [each.channel.topic for each in packed.messages(asked, header)]
    numbers = [each.channel.number for each in packed.messages(asked, header)]
    assert topics[0] == "/camera/image"
    after = numbers[numbers.index(schemas.EXPERT_CHANNELS[schemas.EXPERT].number) + 1 :]
    assert len(after) == 4
    assert after == sorted(after)
    assert len(numbers) == len(set(numbers)) == 1 + 5 + 1 + 3 + 1 + 4


def test_numbers_of_samples_keep_their_places() -> None:
    _, samples = crooked_episode(3, 4)
    for row, sample in zip(packed.numbers_of(samples), samples, strict=True):
        assert row["action"].tolist() == [sample.action_v_mps, sample.action_w_radps]
        assert row["goal_xy_m"].tolist() == list(sample.goal_xy_robot_m)
        assert row["pose"].tolist() == list(sample.robot_xyzyaw)
        for name in ("human_distance_m", "time_to_collision_s", "expert_cost", "human_visible", "replanned"):
            assert row[name] == getattr(sample, name), name
