import hashlib
import os

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader

from readygo.common.dataset import Provenance, ShardWriter, encode_episode
from readygo.common.dataset.index import index_path
from readygo.common.dataset.provenance import provenance_from_strings
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import PROVENANCE, golden_episode, make_episode, write_shard

GOLDEN_SHARD_SHA256 = "c692843b7bc34f5033ed19169f9e5efb67b6aa5255e49520bdff2ffaf694c9a0"
"""Of a shard without outputs; the schemas that protobuf packages bring are part of it."""

CHANNEL_SCHEMAS = {
    "/camera/image": "foxglove.CompressedImage",
    "/camera/calibration": "foxglove.CameraCalibration",
    "/robot/pose": "foxglove.PoseInFrame",
    "/humans": "foxglove.PosesInFrame",
    "/robot/action": "readygo.Action",
    "/robot/goal": "readygo.Goal",
    "/truth": "readygo.StepTruth",
    "/episode/start": "readygo.EpisodeStart",
    "/episode/commit": "readygo.EpisodeCommit",
}


@pytest.mark.parametrize("reader", [make_reader, NonSeekingReader])
def test_mcap_readers_open_shards_and_find_all_checksums_right(tmp_path, reader) -> None:
    shard = write_shard(tmp_path, [2, 0, 1])
    with shard.open("rb") as file:
        messages = list(reader(file, validate_crcs=True).iter_messages())
    assert len(messages) == 3 * (12 * 6 + 3)
    assert {channel.topic: schema.name for schema, channel, _ in messages} == CHANNEL_SCHEMAS
    assert {schema.encoding for schema, _, _ in messages} == {"protobuf"}
    times = [message.log_time for _, _, message in messages if reader is make_reader]
    assert times == sorted(times)


def test_summary_counts_and_finds_every_chunk(tmp_path) -> None:
    shard = write_shard(tmp_path, [2, 0, 1])
    with shard.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        poses = list(reader.iter_messages(topics="/robot/pose", starting_at=100_000_000_000, ending_before=10**11 + 1))
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 225
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) == 3
    assert summary.statistics.channel_message_counts == {1: 3, 2: 3, 3: 36, 4: 36, 5: 36, 6: 36, 7: 36, 8: 36, 9: 3}
    assert len(summary.channels) == len(summary.schemas) == 9
    assert [message.log_time for _, _, message in poses] == [100_000_000_000]


def test_provenance_comes_back(tmp_path) -> None:
    shard = write_shard(tmp_path, [0])
    with shard.open("rb") as file:
        (record,) = make_reader(file).iter_metadata()
    assert provenance_from_strings(record.metadata) == PROVENANCE


def test_metadata_that_is_no_plain_data_is_refused_without_leaving_a_file(tmp_path) -> None:
    with pytest.raises(DatasetError, match="must be plain values"):
        ShardWriter(tmp_path / "shard-r0-00000.mcap", Provenance(config={"robot": object()}))
    assert list(tmp_path.iterdir()) == []


def test_open_shard_has_another_name_until_it_is_closed(tmp_path) -> None:
    writer = ShardWriter(tmp_path / "shard-r0-00000.mcap", PROVENANCE)
    header, samples = make_episode(0)
    writer.append(encode_episode(header, 1, samples))
    assert [path.name for path in tmp_path.iterdir()] == ["shard-r0-00000.mcap.part"]
    assert writer.close() == tmp_path / "shard-r0-00000.mcap"
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".index", ".mcap"]


@pytest.fixture
def synced_sizes(monkeypatch):
    """Sizes of the files [bytes] at each `os.fsync`, by inode."""
    sizes: dict[int, list[int]] = {}
    fsync = os.fsync

    def watched(descriptor):
        status = os.fstat(descriptor)
        sizes.setdefault(status.st_ino, []).append(status.st_size)
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    return sizes


def test_episode_is_on_the_disk_when_append_returns(tmp_path, synced_sizes) -> None:
    writer = ShardWriter(tmp_path / "shard-r0-00000.mcap", PROVENANCE)
    part = (tmp_path / "shard-r0-00000.mcap.part").stat()
    for index in range(2):
        writer.append(encode_episode(*_with_attempt(*make_episode(index))))
        assert synced_sizes[part.st_ino][-1] == (tmp_path / "shard-r0-00000.mcap.part").stat().st_size
    assert len(set(synced_sizes[part.st_ino])) == 3
    assert len(synced_sizes[tmp_path.stat().st_ino]) == 1
    writer.close()
    assert synced_sizes[part.st_ino][-1] == (tmp_path / "shard-r0-00000.mcap").stat().st_size
    assert len(synced_sizes[tmp_path.stat().st_ino]) == 2


def test_speed_is_bought_with_durability_on_request_only(tmp_path, synced_sizes) -> None:
    with ShardWriter(tmp_path / "shard-r0-00000.mcap", PROVENANCE, fsync=False) as writer:
        writer.append(encode_episode(*_with_attempt(*make_episode(0))))
    assert synced_sizes == {}


def test_same_episodes_give_the_same_file(tmp_path) -> None:
    one, other = write_shard(tmp_path / "a", [0, 1]), write_shard(tmp_path / "b", [0, 1])
    assert one.read_bytes() == other.read_bytes()
    assert one.with_suffix(".index").read_bytes() == other.with_suffix(".index").read_bytes()


def test_bytes_of_a_shard_without_outputs_do_not_change_between_versions(tmp_path, monkeypatch) -> None:
    shard = tmp_path / "shard-r0-00000.mcap"
    strings = {"config": '{"robot": null}', "format": '"readygo-shard/1"'}
    monkeypatch.setattr("readygo.common.dataset.writer.provenance_to_strings", lambda _: strings)
    with ShardWriter(shard, Provenance(), fsync=False) as writer:
        writer.append(encode_episode(*_with_attempt(*golden_episode())))
    assert hashlib.sha256(shard.read_bytes()).hexdigest() == GOLDEN_SHARD_SHA256
    with np.load(index_path(shard)) as arrays:
        assert arrays.files == ["header", "episodes", "samples"]


@pytest.mark.parametrize("reader", [make_reader, NonSeekingReader])
def test_outputs_are_further_channels_of_compressed_images(tmp_path, reader) -> None:
    shard = write_shard(tmp_path, [1, 0], outputs=("mask", "depth", "normal"), sample_count=5)
    with shard.open("rb") as file:
        messages = list(reader(file, validate_crcs=True).iter_messages())
    schemas = {channel.topic: schema.name for schema, channel, _ in messages}
    extra = dict.fromkeys(("/camera/depth", "/camera/mask", "/camera/normal"), "foxglove.CompressedImage")
    assert schemas == CHANNEL_SCHEMAS | extra
    assert len(messages) == 2 * (5 * 9 + 3)


def test_outputs_are_png_images_to_viewers(tmp_path) -> None:
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    shard = write_shard(tmp_path, [1], outputs=("depth",), sample_count=3)
    samples = make_episode(1, 3, outputs=("depth",))[1]
    with shard.open("rb") as file:
        found = [m for _, _, m in make_reader(file).iter_messages(topics="/camera/depth")]
    for sample, message in zip(samples, found, strict=True):
        image = CompressedImage.FromString(message.data)
        assert (image.format, image.frame_id, image.data) == ("png", "camera", sample.outputs["depth"])
        assert image.timestamp.ToNanoseconds() == message.log_time == 100_000_000_000 + sample.time_ns


def test_episode_with_other_outputs_than_its_shard_is_refused(tmp_path) -> None:
    header, samples = make_episode(0, 2, outputs=("depth",))
    with ShardWriter(tmp_path / "shard-r0-00000.mcap", PROVENANCE, outputs=("depth", "mask")) as writer:
        with pytest.raises(DatasetError, match=r"000000 has the outputs \['depth'\], its shard \['depth', 'mask'\]"):
            writer.append(encode_episode(header, 1, samples))
        assert writer.episode_count == 0


def test_shard_with_an_unknown_output_is_refused_without_leaving_a_file(tmp_path) -> None:
    with pytest.raises(DatasetError, match="no channel for 'thermal'"):
        ShardWriter(tmp_path / "shard-r0-00000.mcap", PROVENANCE, outputs=("thermal",))
    assert list(tmp_path.iterdir()) == []


def _with_attempt(header, samples):
    return header, 1, samples
