import errno
from pathlib import Path

import pytest
from mcap.reader import make_reader

from readygo.common.dataset import Dataset, validate
from readygo.common.dataset.stage import PAUSE_NS
from readygo.common.errors import RunError
from readygo.common.messages import (
    AppendRequest,
    decode,
    encode,
)
from tests.common.dataset.episodes import append_requests, make_episode, write_shard
from tests.services.recorder.by_hand import crash, names, send


def test_full_shard_is_finished_at_once(make_recorder, tmp_path) -> None:
    recorder = make_recorder()
    for index in range(4):
        send(recorder, append_requests(index))
    assert [entry.episode.index for entry in Dataset([tmp_path]).episodes] == [0, 1, 2]
    recorder.close()
    assert len(Dataset([tmp_path]).episodes) == 4


def chunk_times_ns(folder: Path) -> list[tuple[int, int]]:
    """First and last time of every chunk, shard by shard."""
    times = []
    for shard in sorted(folder.glob("*.mcap")):
        with shard.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None
        times += [(index.message_start_time, index.message_end_time) for index in summary.chunk_indexes]
    return times


def test_time_runs_on_from_shard_to_shard_and_over_a_restart(make_recorder, tmp_path) -> None:
    for indices in ((4, 0), (1, 3)):
        recorder = make_recorder(episodes_per_shard=1)
        for index in indices:
            send(recorder, append_requests(index))
        recorder.close()
    times = chunk_times_ns(tmp_path)
    assert len(list(tmp_path.glob("*.mcap"))) == len(times) == 4
    assert times[0][0] == 0
    assert [start - PAUSE_NS for start, _ in times[1:]] == [end for _, end in times[:-1]]


def test_a_run_of_the_first_format_goes_on_in_todays(make_recorder, tmp_path) -> None:
    write_shard(tmp_path, [0, 2])
    recorder = make_recorder()
    assert send(recorder, append_requests(2))[-1] == "dup"
    assert send(recorder, append_requests(1))[-1] == "committed"
    recorder.close()
    assert [entry.episode.index for entry in Dataset([tmp_path]).episodes] == [0, 1, 2]
    assert validate(tmp_path).defects == ()
    _, before, after = chunk_times_ns(tmp_path)
    assert after[0] == before[1] + PAUSE_NS


def test_recorder_without_episodes_leaves_nothing(make_recorder, tmp_path) -> None:
    make_recorder().close()
    assert names(tmp_path) == []


def test_full_disk_while_a_shard_is_finished_loses_nothing(make_recorder, tmp_path, monkeypatch) -> None:
    recorder = make_recorder(episodes_per_shard=1)

    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("readygo.common.dataset.writer.os.replace", refuse)
    assert send(recorder, append_requests(0)) == ["ok", "committed"]
    assert send(recorder, append_requests(1)) == ["ok", "retry"]
    monkeypatch.undo()
    monkeypatch.setattr("readygo.services.recorder.handlers.FULL_S", 0.0)
    assert recorder.settle()
    recorder.close()
    assert len(Dataset([tmp_path]).episodes) == 2
    assert validate(tmp_path).defects == ()


def test_nothing_follows_a_failed_write_that_cannot_be_cut_off(make_recorder, tmp_path, monkeypatch) -> None:
    recorder = make_recorder()
    send(recorder, append_requests(0))

    def refuse(*arguments: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("readygo.common.dataset.writer.os.write", refuse)
    monkeypatch.setattr("readygo.common.dataset.writer.os.ftruncate", refuse)
    with pytest.raises(RunError, match=r"Writing to .* failed: Input/output error"):
        send(recorder, append_requests(1))
    monkeypatch.undo()
    with pytest.raises(RunError, match="not open any more"):
        send(recorder, append_requests(1, attempt=2))
    crash(recorder)
    resumed = make_recorder()
    resumed.settle()
    assert len(Dataset([tmp_path]).episodes) == 1


def test_outputs_are_recorded_and_found_again(make_recorder, tmp_path) -> None:
    recorder = make_recorder()
    for index in range(4):
        requests = append_requests(index, outputs=("depth", "mask"))
        assert send(recorder, [decode(AppendRequest, encode(request)) for request in requests])[-1] == "committed"
    recorder.close()
    assert validate(tmp_path).defects == ()
    dataset, samples = Dataset([tmp_path]), make_episode(2, outputs=("depth", "mask"))[1]
    assert dataset.outputs == ("rgb", "depth", "mask")
    assert [dataset.output(24 + seq, "mask") for seq in range(12)] == [sample.outputs["mask"] for sample in samples]


def test_episodes_with_other_outputs_go_into_a_shard_of_their_own(make_recorder, tmp_path) -> None:
    recorder = make_recorder()
    for index, outputs in enumerate([(), ("depth",), ("depth",)]):
        send(recorder, append_requests(index, outputs=outputs))
    recorder.close()
    assert validate(tmp_path).defects == ()
    assert [entry.shard.name[-6] for entry in Dataset([tmp_path]).episodes] == ["0", "1", "1"]
