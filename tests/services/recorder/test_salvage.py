import errno
import shutil
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.opcode import Opcode

from readygo.common.dataset import Dataset, ShardWriter, encode_episode, validate
from readygo.common.dataset.records import Record, chunk_span, iter_messages, iter_records
from readygo.common.dataset.stage import Scenery
from readygo.common.errors import DatasetError
from readygo.services.recorder import Recorder, RecorderConfig, handle_append
from readygo.services.recorder.salvage import (
    drop_episodes,
    finished_episodes,
    next_number,
    next_start_ns,
    open_shards,
    read_open_shard,
)
from tests.common.dataset.episodes import PROVENANCE, append_requests, make_episode, write_shard
from tests.common.dataset.maps import make_maps
from tests.services.recorder.coordinator import FakeCoordinator

PART = "shard-r0-00000.mcap.part"


def make_part(folder: Path, indices: tuple[int, ...] = (0, 1)) -> tuple[Path, list[int]]:
    """An open shard as a killed recorder leaves it, and its size after each episode."""
    writer = ShardWriter(folder / PART.removesuffix(".part"), PROVENANCE, fsync=False)
    sizes = []
    for index in indices:
        header, samples = make_episode(index, 4)
        writer.append(encode_episode(header, 1, samples))
        sizes.append((folder / PART).stat().st_size)
    writer.abandon()
    return folder / PART, sizes


def start(folder: Path, coordinator: FakeCoordinator) -> Recorder:
    return Recorder(folder, "r0", coordinator.bus, PROVENANCE, RecorderConfig(fsync=False))


def records_of(part: Path) -> list[Record]:
    """All records of an open shard, which has no footer."""
    records = []
    with suppress(DatasetError):
        for record in iter_records(memoryview(part.read_bytes())):
            records.append(record)
    return records


def interesting_offsets(part: Path) -> list[int]:
    """In and around every record, and around every message of the last chunk."""
    data, records = part.read_bytes(), records_of(part)
    assert records[-1].end == len(data)
    offsets = {0, 1, 7, 8}
    for record in records:
        offsets |= {record.offset, record.offset + 1, record.body, record.body + 1, record.end - 1, record.end}
    view = memoryview(data)
    chunk = chunk_span(view, [record for record in records if record.opcode == Opcode.CHUNK][-1])
    for message in iter_messages(view, chunk.body, chunk.end):
        offsets |= {message.offset, message.offset + 5, message.body, message.end - 1}
    return sorted(offsets)


def test_truncation_anywhere_keeps_exactly_the_whole_episodes(tmp_path) -> None:
    part, _ = make_part(tmp_path)
    data = part.read_bytes()
    chunk_ends = [record.end for record in records_of(part) if record.opcode == Opcode.CHUNK]
    offsets = interesting_offsets(part)
    assert len(offsets) > 150
    for offset in offsets:
        part.write_bytes(data[:offset])
        whole = sum(end <= offset for end in chunk_ends)
        assert [chunk.episode.index for chunk in read_open_shard(part).chunks] == [0, 1][:whole], offset


@pytest.mark.parametrize("cut", [-3000, -1, 0])
def test_start_publishes_whole_episodes_and_reports_the_others_lost(tmp_path, cut) -> None:
    part, _ = make_part(tmp_path)
    data = part.read_bytes()
    part.write_bytes(data[: len(data) + cut])
    coordinator = FakeCoordinator()
    coordinator.granted = {0: 1, 1: 1, 2: 1}
    recorder = start(tmp_path, coordinator)
    recorder.settle()
    saved = [0] if cut == -3000 else [0, 1]
    assert coordinator.done_indices == saved
    assert [(report.index, report.reason) for report in coordinator.lost] == [
        (index, "") for index in (1, 2) if index not in saved
    ]
    assert [entry.episode.index for entry in Dataset([tmp_path]).episodes] == saved
    assert validate(tmp_path).defects == ()
    assert not part.exists()
    assert handle_append(recorder, append_requests(0, 4)[0]).status.value == "dup"
    recorder.close()


def test_salvaged_shard_has_the_bytes_of_an_undisturbed_one(tmp_path) -> None:
    (tmp_path / "crashed").mkdir()
    (tmp_path / "smooth").mkdir()
    make_part(tmp_path / "crashed")
    start(tmp_path / "crashed", FakeCoordinator()).close()
    smooth = start(tmp_path / "smooth", FakeCoordinator())
    for index in (0, 1):
        for request in append_requests(index, 4):
            handle_append(smooth, request)
    smooth.close()
    shards = [tmp_path / name / "shard-r0-00000.mcap" for name in ("crashed", "smooth")]
    assert shards[0].read_bytes() == shards[1].read_bytes()


def test_an_episode_that_is_left_out_leaves_no_gap_in_time(tmp_path) -> None:
    stage = Scenery()
    writer = ShardWriter(tmp_path / PART.removesuffix(".part"), PROVENANCE, stage=stage, fsync=False)
    for index in (0, 1, 2):
        header, samples = make_episode(index, 4)
        writer.append(encode_episode(header, 1, samples))
    writer.abandon()
    coordinator = FakeCoordinator()
    coordinator.stale_done = {0, 1}
    start(tmp_path, coordinator).close()
    (tmp_path / "alone").mkdir()
    alone = write_shard(tmp_path / "alone", [2], sample_count=4, stage=stage)
    assert (tmp_path / alone.name).read_bytes() == alone.read_bytes()


def test_new_shards_do_not_take_old_names(tmp_path) -> None:
    make_part(tmp_path, (0,))
    recorder = start(tmp_path, FakeCoordinator())
    for request in append_requests(1, 4):
        handle_append(recorder, request)
    recorder.close()
    assert sorted(path.name for path in tmp_path.glob("*.mcap")) == ["shard-r0-00000.mcap", "shard-r0-00001.mcap"]


def test_open_shard_without_a_whole_episode_is_removed(tmp_path) -> None:
    for data in (b"", b"\x89MCAP0\r\n", b"something else entirely"):
        (tmp_path / PART).write_bytes(data)
        start(tmp_path, FakeCoordinator()).close()
        assert list(tmp_path.iterdir()) == []


def test_damaged_chunk_does_not_cost_the_others(tmp_path) -> None:
    part, sizes = make_part(tmp_path, (0, 1, 2))
    data = bytearray(part.read_bytes())
    data[sizes[0] + 2000] ^= 1
    part.write_bytes(data)
    coordinator = FakeCoordinator()
    start(tmp_path, coordinator).close()
    assert coordinator.done_indices == [0, 2]
    assert validate(tmp_path).defects == ()


def test_salvage_waits_for_the_coordinator(tmp_path) -> None:
    part, _ = make_part(tmp_path)
    coordinator = FakeCoordinator()
    coordinator.go_away()
    recorder = start(tmp_path, coordinator)
    assert not recorder.settle()
    assert part.exists()
    coordinator.away.clear()
    assert recorder.settle()
    assert not part.exists()
    recorder.close()


def test_episode_that_went_elsewhere_is_left_out(tmp_path) -> None:
    make_part(tmp_path)
    coordinator = FakeCoordinator()
    coordinator.stale_done = {0}
    start(tmp_path, coordinator).close()
    assert [entry.episode.index for entry in Dataset([tmp_path]).episodes] == [1]


def test_crash_between_publishing_and_removing_the_open_shard_duplicates_nothing(tmp_path) -> None:
    part, _ = make_part(tmp_path)
    saved = tmp_path / "saved"
    shutil.copy(part, saved)
    start(tmp_path, FakeCoordinator()).close()
    shutil.move(saved, part)
    coordinator = FakeCoordinator()
    start(tmp_path, coordinator).close()
    assert coordinator.done == []
    assert sorted(path.name for path in tmp_path.glob("shard-*")) == ["shard-r0-00000.index", "shard-r0-00000.mcap"]


def test_full_disk_during_salvage_keeps_the_open_shard(tmp_path, monkeypatch) -> None:
    part, _ = make_part(tmp_path)
    data = part.read_bytes()

    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    recorder = start(tmp_path, FakeCoordinator())
    monkeypatch.setattr("readygo.common.dataset.writer.os.write", refuse)
    monkeypatch.setattr("readygo.services.recorder.handlers.FULL_S", 0.0)
    assert not recorder.settle()
    monkeypatch.undo()
    monkeypatch.setattr("readygo.services.recorder.handlers.FULL_S", 0.0)
    assert part.read_bytes() == data
    assert recorder.settle()
    recorder.close()
    assert len(Dataset([tmp_path]).episodes) == 2


def test_restart_answers_for_episodes_of_finished_shards(tmp_path) -> None:
    coordinator = FakeCoordinator()
    recorder = start(tmp_path, coordinator)
    coordinator.away = {"done"}
    for request in append_requests(0, 4):
        handle_append(recorder, request)
    recorder.close()
    coordinator.away.clear()
    assert coordinator.granted == {0: 1}
    restarted = start(tmp_path, coordinator)
    assert restarted.settle()
    assert (coordinator.done_indices, coordinator.lost) == ([0], [])
    restarted.close()


def test_damaged_finished_shard_stops_the_start_and_frees_the_name(tmp_path) -> None:
    recorder = start(tmp_path, FakeCoordinator())
    for request in append_requests(0, 4):
        handle_append(recorder, request)
    recorder.close()
    shard = tmp_path / "shard-r0-00000.mcap"
    data = shard.read_bytes()
    shard.write_bytes(data[:-20])
    with pytest.raises(DatasetError, match="is truncated"):
        start(tmp_path, FakeCoordinator())
    shard.write_bytes(data)
    start(tmp_path, FakeCoordinator()).close()


def test_outputs_survive_a_crash(tmp_path) -> None:
    writer = ShardWriter(tmp_path / PART.removesuffix(".part"), PROVENANCE, outputs=("depth", "mask"), fsync=False)
    for index in (0, 1):
        header, samples = make_episode(index, 4, outputs=("depth", "mask"))
        writer.append(encode_episode(header, 1, samples))
    writer.abandon()
    coordinator = FakeCoordinator()
    recorder = start(tmp_path, coordinator)
    assert recorder.settle()
    recorder.close()
    dataset = Dataset([tmp_path])
    assert dataset.outputs == ("rgb", "depth", "mask")
    assert dataset.output(7, "mask") == make_episode(1, 4, outputs=("mask",))[1][3].outputs["mask"]
    assert validate(tmp_path).defects == ()


def test_shard_without_its_first_episode_begins_when_it_began_and_shows_the_map(tmp_path) -> None:
    stage = Scenery(maps=make_maps())  # type: ignore[arg-type]
    shard = write_shard(tmp_path, (0, 1, 2), stage=stage)
    want = write_shard(tmp_path / "want", (1, 2), stage=stage)
    assert drop_episodes(shard, {0}, stage)
    assert shard.read_bytes() == want.read_bytes()
    assert validate(tmp_path).ok
    assert not drop_episodes(shard, {0, 1}, stage)
    assert [path.name for path in tmp_path.iterdir()] == ["want"]


def test_numbers_and_times_of_a_recorder_go_on_behind_its_own_files(tmp_path) -> None:
    assert (next_number(tmp_path, "r0"), next_start_ns(tmp_path, "r0")) == (0, 0)
    for name in ("shard-r0-00004.mcap.part", "shard-r0-00011.mcap.salvage", "shard-r00-00033.mcap", "shard-r0-x.mcap"):
        (tmp_path / name).write_bytes(b"")
    assert (next_number(tmp_path, "r0"), next_start_ns(tmp_path, "r0")) == (12, 0)
    assert next_number(tmp_path, "r00") == 34


def test_shards_from_the_hundred_thousandth_on_are_known_and_the_last_one_is_continued(tmp_path) -> None:
    write_shard(tmp_path, (0,), number=99_999, sample_count=4)
    write_shard(tmp_path, (1,), number=100_000, sample_count=8)
    assert sorted(finished_episodes(tmp_path, "r0")) == [0, 1]
    assert next_number(tmp_path, "r0") == 100_001
    last = tmp_path / "last"
    write_shard(last, (1,), sample_count=8)
    assert next_start_ns(tmp_path, "r0") == next_start_ns(last, "r0")
    (tmp_path / "shard-r0-100001.mcap.part").write_bytes(b"")
    assert next_number(tmp_path, "r0") == 100_002
    assert len(open_shards(tmp_path, "r0")) == 1
