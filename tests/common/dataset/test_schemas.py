"""Channels and messages of a shard."""

import dataclasses

import pytest

from readygo.common.dataset import encode_episode, schemas
from readygo.common.dataset.records import iter_messages
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import make_episode


def test_every_channel_carries_its_descriptor_with_imports() -> None:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    for channel in schemas.channels_with(schemas.OPTIONAL_CHANNELS):
        files = descriptor_pb2.FileDescriptorSet.FromString(schemas.descriptor_set(channel.message)).file
        pool = descriptor_pool.DescriptorPool()
        for file in files:
            pool.Add(file)
        name = channel.message.DESCRIPTOR.full_name
        assert message_factory.GetMessageClass(pool.FindMessageTypeByName(name))().DESCRIPTOR.full_name == name


def test_channel_numbers_are_their_positions() -> None:
    channels = schemas.channels_with(schemas.OPTIONAL_CHANNELS)
    assert [channel.number for channel in channels] == [*range(1, 19), 27, 28]


def test_output_without_a_channel_is_refused() -> None:
    header, samples = make_episode(0, 1)
    with pytest.raises(DatasetError, match="no channel for 'thermal' images; known are depth, median_depth"):
        encode_episode(header, 1, [dataclasses.replace(samples[0], outputs={"thermal": b"hot"})])


def test_an_image_may_not_have_the_name_of_a_label() -> None:
    header, samples = make_episode(0, 1)
    with pytest.raises(DatasetError, match="no channel for 'joints' images"):
        encode_episode(header, 1, [dataclasses.replace(samples[0], outputs={"joints": b""})])


@pytest.mark.parametrize(
    ("model", "coefficients"), [("plumb_bob", (0.1, -0.2, 0.3, 0.4, 0.5)), ("kannala_brandt", (0.1, 0.2, 0.3, 0.4))]
)
def test_calibration_carries_the_distortion(model, coefficients) -> None:
    header, samples = make_episode(0, 1, distortion_model=model, distortion=coefficients)
    chunk = encode_episode(header, 1, samples)
    view = memoryview(chunk.data)
    found = [m for m in iter_messages(view, 0, len(view)) if m.channel == schemas.CALIBRATION.number]
    calibration = schemas.CALIBRATION.message.FromString(view[found[0].body : found[0].end])
    assert (calibration.distortion_model, tuple(calibration.D)) == (model, coefficients)
    assert tuple(calibration.K) == header.K_px
