"""Messages made by hand, beside those of the protobuf library."""

import dataclasses
import math

import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from readygo.common.dataset import packed, schemas
from readygo.common.dataset.poses import pose_of
from tests.common.dataset.episodes import make_episode

NUMBERS = (0.0, -0.0, 1.5, -2.5, math.inf, math.nan, 5e-324)


@pytest.mark.parametrize("time_ns", [0, 1, 999_999_999, 10**9, 127 * 10**9 + 50_000_000, 128 * 10**9, 2**63 - 1])
def test_times_are_those_of_the_library(time_ns: int) -> None:
    assert packed.stamp(time_ns) == schemas.serialized(CompressedImage(timestamp=schemas.timestamp(time_ns)))


@pytest.mark.parametrize("x", NUMBERS)
@pytest.mark.parametrize("y", NUMBERS)
@pytest.mark.parametrize("z", NUMBERS)
def test_vectors_are_those_of_the_library(x: float, y: float, z: float) -> None:
    assert packed.vector(x, y, z) == schemas.serialized(Vector3(x=x, y=y, z=z))


@pytest.mark.parametrize("value", [0, 1, 127, 128, 16_383, 16_384, 2**40])
def test_whole_numbers_are_those_of_the_library(value: int) -> None:
    message = schemas.EPISODE_START.message(seed=value)
    assert schemas.serialized(message) == (b"\x10" + packed.varint(value) if value else b"")


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3, -3.0, math.pi])
@pytest.mark.parametrize("z_m", [0.0, -0.1])
def test_a_samples_poses_and_image_are_those_of_the_library(yaw_rad: float, z_m: float) -> None:
    header, (sample, *_) = make_episode(0)
    humans = ((1.0, 0.0, z_m, yaw_rad), (0.0, 0.0, 0.0, 0.0))
    sample = dataclasses.replace(sample, humans_xyzyaw=humans)
    stamp = schemas.timestamp(1_500_000_000)
    by_channel = {
        content.channel: content.at(packed.stamp(1_500_000_000)) for content in packed.contents(sample, header)
    }
    poses = PosesInFrame(timestamp=stamp, frame_id="world", poses=[pose_of(*human) for human in humans])
    image = CompressedImage(timestamp=stamp, frame_id="camera", data=sample.image, format=header.image_format)
    assert b"".join(by_channel[schemas.HUMANS]) == schemas.serialized(poses)
    assert b"".join(by_channel[schemas.IMAGE]) == schemas.serialized(image)
