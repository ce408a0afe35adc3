import pytest
from mcap.reader import NonSeekingReader, make_reader

from common.dataset import ShardWriter, encode_episode
from common.dataset.metadata import metadata_from_strings
from common.errors import DatasetError
from tests.common.dataset.episodes import METADATA, make_episode, write_shard

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


def test_metadata_comes_back(tmp_path) -> None:
    shard = write_shard(tmp_path, [0])
    with shard.open("rb") as file:
        (record,) = make_reader(file).iter_metadata()
    assert metadata_from_strings(record.metadata) == METADATA


def test_metadata_that_is_no_plain_data_is_refused_without_leaving_a_file(tmp_path) -> None:
    with pytest.raises(DatasetError, match="must be plain values"):
        ShardWriter(tmp_path / "shard-r0-00000.mcap", {"robot": object()})
    assert list(tmp_path.iterdir()) == []


def test_open_shard_has_another_name_until_it_is_closed(tmp_path) -> None:
    writer = ShardWriter(tmp_path / "shard-r0-00000.mcap", METADATA)
    header, samples = make_episode(0)
    writer.append(encode_episode(header, 1, samples))
    assert [path.name for path in tmp_path.iterdir()] == ["shard-r0-00000.mcap.part"]
    assert writer.close() == tmp_path / "shard-r0-00000.mcap"
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".index", ".mcap"]


def test_same_episodes_give_the_same_file(tmp_path) -> None:
    one, other = write_shard(tmp_path / "a", [0, 1]), write_shard(tmp_path / "b", [0, 1])
    assert one.read_bytes() == other.read_bytes()
    assert one.with_suffix(".index").read_bytes() == other.with_suffix(".index").read_bytes()
