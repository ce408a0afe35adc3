import dataclasses
import importlib
import struct

import numpy as np
import pytest

from readygo.common.dataset import Dataset, Provenance, ShardWriter, encode_episode, schemas, validate
from readygo.common.dataset.committed import committed_episodes
from readygo.common.dataset.index import index_path, load_index, write_index
from readygo.common.errors import DatasetError
from tests.common.dataset.defects import kinds, texts
from tests.common.dataset.episodes import (
    LEFT,
    PROVENANCE,
    make_episode,
    provenance_with_robot,
    with_goal_image,
    with_left_camera,
    write_shard,
)
from tests.common.dataset.forge import chunks_of, rewrite


def test_good_dataset_has_no_defects_and_is_counted(shard) -> None:
    progress = []
    report = validate(shard.parent, progress=lambda done, total: progress.append((done, total)))
    assert report.ok
    assert (report.shard_count, report.episode_count, report.sample_count) == (1, 2, 24)
    assert report.notes == ()
    size = shard.stat().st_size
    assert progress[-1] == (size, size)
    assert len(progress) == 3


def test_missing_folder_is_an_error_not_a_defect(tmp_path) -> None:
    with pytest.raises(DatasetError, match="does not exist"):
        validate(tmp_path / "nowhere")


def test_rewriting_without_a_change_is_no_defect(shard) -> None:
    rewrite(shard, lambda records: records)
    assert validate(shard.parent).ok


def test_flipped_byte_in_an_image_is_found(shard) -> None:
    offset = int(load_index(shard).samples[5]["image_offset"])
    data = bytearray(shard.read_bytes())
    data[offset + 50] ^= 1
    shard.write_bytes(data)
    assert {"crc", "sha256"} <= kinds(shard.parent)
    assert "chunk at byte" in texts(shard.parent)


def test_any_flipped_byte_of_the_file_is_found(tmp_path) -> None:
    shard = write_shard(tmp_path, [0], sample_count=1)
    data = shard.read_bytes()
    for offset in range(3, len(data), max(1, len(data) // 150)):
        damaged = bytearray(data)
        damaged[offset] ^= 0x04
        shard.write_bytes(damaged)
        assert not validate(tmp_path).ok, offset


def test_every_truncation_is_found(shard) -> None:
    data = shard.read_bytes()
    for cut in (1, 9, 40, 500, len(data) // 2, len(data) - 3, len(data)):
        shard.write_bytes(data[:-cut])
        assert kinds(shard.parent) == {"file"}


def test_duplicate_episode_is_found(tmp_path) -> None:
    write_shard(tmp_path, [0, 1], number=0)
    write_shard(tmp_path, [2, 1], number=1)
    report = validate(tmp_path)
    assert [(defect.shard, defect.kind) for defect in report.defects] == [("shard-r0-00001.mcap", "duplicate")]
    assert "train-7-000001 is in shard-r0-00000.mcap already" in str(report.defects[0])


def test_limits_are_those_of_the_recorded_robot(tmp_path) -> None:
    write_shard(tmp_path, [0], provenance=provenance_with_robot(v_max_mps=0.5), sample_count=15)
    assert "beyond the robot's limits at samples 10, 11, 12, 13, 14" in texts(tmp_path)


def test_data_without_a_robot_is_noted(tmp_path) -> None:
    write_shard(tmp_path, [0], provenance=Provenance())
    report = validate(tmp_path)
    assert report.ok
    assert report.notes == ("The metadata names no robot: its limits were not checked.",)


def test_index_of_other_content_is_found(shard) -> None:
    index = load_index(shard)
    samples = index.samples.copy()
    samples["image_offset"][3] += 1
    write_index(dataclasses.replace(index, samples=samples), index_path(shard))
    assert kinds(shard.parent) == {"index"}
    index_path(shard).write_bytes(b"damaged")
    assert kinds(shard.parent) == {"index"}


def test_missing_index_is_noted(shard) -> None:
    index_path(shard).unlink()
    report = validate(shard.parent)
    assert report.ok
    assert report.notes == ("shard-r0-00000.mcap has no index; readers make it again.",)


def test_open_shards_are_noted(shard) -> None:
    shard.with_name("shard-r0-00001.mcap.part").write_bytes(b"")
    report = validate(shard.parent)
    assert report.ok
    assert "1 shards are open" in report.notes[0]


def test_shard_of_another_robot_is_found(shard) -> None:
    write_shard(shard.parent, [5], number=1, provenance=provenance_with_robot(radius_m=0.2))
    assert "its robot is not that of shard-r0-00000.mcap" in texts(shard.parent)


def test_shard_without_our_metadata_is_found(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("readygo.common.dataset.writer.RECORD_NAME", "somebody-else")
    write_shard(tmp_path, [0])
    assert kinds(tmp_path) == {"metadata"}


def test_foreign_file_under_a_shard_name_is_found(shard) -> None:
    shard.with_name("shard-r0-00001.mcap").write_bytes(b"not an MCAP file at all" * 100)
    report = validate(shard.parent)
    assert {defect.shard for defect in report.defects} == {"shard-r0-00001.mcap"}
    assert report.episode_count == 2


def test_forging_tool_reads_back_what_was_written(shard) -> None:
    assert [chunk.episode.index for chunk in chunks_of(shard)] == [0, 1]


def test_good_dataset_with_outputs_has_no_defects(rich_shard) -> None:
    report = validate(rich_shard.parent)
    assert report.ok
    assert (report.episode_count, report.sample_count, report.notes) == (2, 24, ())


def test_rewriting_outputs_without_a_change_is_no_defect(rich_shard) -> None:
    rewrite(rich_shard, lambda records: records)
    assert validate(rich_shard.parent).ok


def test_episode_without_an_output_of_its_shard_is_found(rich_shard, monkeypatch) -> None:
    # The writer would refuse it.
    monkeypatch.setattr(ShardWriter, "append", _append_unchecked)
    rewrite(rich_shard, lambda records: [r for r in records if r.channel != schemas.OUTPUT_CHANNELS["mask"]])
    assert "/camera/mask lacks samples 0, 1, 2, 3, 4 and 7 more" in texts(rich_shard.parent)


def _append_unchecked(writer, chunk, append=ShardWriter.append) -> None:
    outputs, writer.outputs = writer.outputs, tuple(chunk.outputs)
    append(writer, chunk)
    writer.outputs = outputs


def test_output_that_the_shard_has_no_channel_for_is_found(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(ShardWriter, "append", _append_unchecked)
    with ShardWriter(tmp_path / "shard-r0-00000.mcap", PROVENANCE, outputs=("depth",), fsync=False) as writer:
        header, samples = make_episode(0, outputs=("depth", "mask"))
        writer.append(encode_episode(header, 1, samples))
    assert "a message is on the unknown channel 13" in texts(tmp_path)


def test_flipped_byte_in_an_output_is_found(rich_shard) -> None:
    offset = int(load_index(rich_shard).outputs["depth"]["offset"][5])
    data = bytearray(rich_shard.read_bytes())
    data[offset + 50] ^= 1
    rich_shard.write_bytes(data)
    assert {"crc", "sha256"} <= kinds(rich_shard.parent)


def test_index_with_another_place_of_an_output_is_found(rich_shard) -> None:
    index = load_index(rich_shard)
    index.outputs["mask"]["offset"][3] += 1
    write_index(index, index_path(rich_shard))
    assert kinds(rich_shard.parent) == {"index"}
    del index.outputs["mask"]
    write_index(index, index_path(rich_shard))
    assert kinds(rich_shard.parent) == {"index"}


def test_shard_of_a_robot_with_two_cameras_is_sound_and_read_by_their_names(tmp_path) -> None:
    episodes = [with_goal_image(*with_left_camera(*make_episode(index, 6))) for index in (1, 2)]
    write_chunks(tmp_path, [encode_episode(header, 1, samples) for header, samples in episodes])
    assert validate(tmp_path).ok
    data = Dataset(tmp_path)
    assert data.outputs == ("rgb", "left.rgb", "left.depth")
    assert data.output(3, "left.rgb") == episodes[0][1][3].outputs["left.rgb"]
    assert data.decode_output(3, "left.depth").shape == (LEFT.height_px, LEFT.width_px)
    assert np.array_equal(data.calibration(0, "left").K_px, LEFT.K_px)
    assert data.goal_image(1) == episodes[1][1][0].outputs["goal_image"]
    with pytest.raises(DatasetError, match="no camera 'rear'; besides the first they have left"):
        data.calibration(0, "rear")
    committed = list(committed_episodes(tmp_path))
    assert [episode.header.cameras for episode in committed] == [header.cameras for header, _ in episodes]
    assert [sample.outputs for sample in committed[0].samples] == [sample.outputs for sample in episodes[0][1]]


def test_damaged_image_of_a_further_camera_is_found(tmp_path) -> None:
    header, samples = with_left_camera(*make_episode(1, 6))
    outputs = {**samples[2].outputs, "left.rgb": samples[2].image}
    broken = dataclasses.replace(samples[2], outputs=outputs)
    write_chunks(tmp_path, [encode_episode(header, 1, [*samples[:2], broken, *samples[3:]])])
    assert [(defect.kind, defect.text.split(": ")[1]) for defect in validate(tmp_path).defects] == [
        ("image", "the left.rgb image is damaged or has another size or format at samples 2")
    ]


def write_chunks(folder, chunks) -> None:
    with ShardWriter(folder / "shard-rec0-00000.mcap", PROVENANCE, outputs=chunks[0].outputs, fsync=False) as writer:
        for chunk in chunks:
            writer.append(chunk)


@pytest.mark.parametrize("error", [struct.error("needs 8 bytes"), MemoryError(), OverflowError()])
def test_whatever_an_mcap_reader_raises_is_a_defect(shard, monkeypatch, error) -> None:
    class Reader:
        def get_summary(self) -> None:
            raise error

    module = importlib.import_module("readygo.common.dataset.validate")
    monkeypatch.setattr(module, "make_reader", lambda *_, **__: Reader())
    assert [defect.kind for defect in validate(shard.parent).defects] == ["summary"]
