import dataclasses
import errno
import os
import threading

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.dataset import Dataset, Provenance, validate
from readygo.common.errors import DatasetError, DiskError, RunError
from readygo.common.messages import (
    AppendReply,
    AppendStatus,
    EpisodeKey,
    Split,
    VerdictStatus,
)
from readygo.services.recorder import Recorder, handle_append
from tests.common.dataset.episodes import append_requests
from tests.services.recorder.by_hand import crash, names, send


def test_episode_is_committed_with_its_last_batch(make_recorder, coordinator, tmp_path) -> None:
    recorder = make_recorder()
    assert send(recorder, append_requests(0, 20)) == ["ok", "ok", "committed"]
    assert [(report.index, report.attempt, report.sample_count) for report in coordinator.done] == [(0, 1, 20)]
    recorder.close()
    assert coordinator.done[0].shard == "shard-r0-00000.mcap"
    assert [entry.sample_count for entry in Dataset([tmp_path]).episodes] == [20]
    assert names(tmp_path) == ["shard-r0-00000.index", "shard-r0-00000.mcap"]
    assert validate(tmp_path).defects == ()


def test_batch_sent_again_changes_nothing(make_recorder, coordinator, tmp_path) -> None:
    recorder = make_recorder()
    first, last = append_requests(0)
    assert send(recorder, [first, first, last, last, first]) == ["ok", "ok", "committed", "dup", "dup"]
    recorder.close()
    assert len(Dataset([tmp_path])) == 12
    assert coordinator.done_indices == [0]


def test_missing_batch_is_asked_for(make_recorder) -> None:
    recorder = make_recorder()
    first, second, last = append_requests(0, 20)
    assert handle_append(recorder, second) == AppendReply(status=AppendStatus.GAP, expected_seq=0)
    assert send(recorder, [first]) == ["ok"]
    assert handle_append(recorder, last) == AppendReply(status=AppendStatus.GAP, expected_seq=8)
    assert send(recorder, [second, last]) == ["ok", "committed"]


def test_damaged_sample_is_asked_for_again_but_not_for_ever(make_recorder) -> None:
    recorder = make_recorder()
    good, _ = append_requests(0)
    samples = list(good.samples)
    samples[5] = dataclasses.replace(samples[5], image=samples[5].image[:-1] + b"\0")
    damaged = dataclasses.replace(good, samples=tuple(samples))
    for _ in range(3):
        reply = handle_append(recorder, damaged)
        assert (reply.status.value, reply.expected_seq) == ("gap", 5)
    with pytest.raises(DatasetError, match="sample 5 never matches its CRC-32"):
        handle_append(recorder, damaged)
    assert handle_append(recorder, good).status is AppendStatus.OK


def test_contradicting_batches_are_refused(make_recorder) -> None:
    recorder = make_recorder()
    first, last = append_requests(0)
    send(recorder, [first])
    with pytest.raises(DatasetError, match="two different headers"):
        handle_append(recorder, dataclasses.replace(last, header=dataclasses.replace(last.header, width_px=64)))
    with pytest.raises(DatasetError, match="closed after 10 of 12 samples"):
        handle_append(recorder, dataclasses.replace(last, samples=last.samples[:2]))
    with pytest.raises(DatasetError, match="sent sample 11 where 10 was due"):
        handle_append(recorder, dataclasses.replace(last, first_seq=10, samples=last.samples[3:]))


def test_newer_attempt_replaces_older_one(make_recorder, coordinator) -> None:
    recorder = make_recorder()
    old_first, old_last = append_requests(0, attempt=1)
    new_first, new_last = append_requests(0, attempt=2)
    assert send(recorder, [old_first, new_first, old_last, new_last]) == ["ok", "ok", "stale", "committed"]
    assert coordinator.done[0].attempt == 2


def test_attempt_that_lost_its_lease_is_stale(make_recorder, coordinator, tmp_path) -> None:
    recorder = make_recorder()
    coordinator.verdicts[0] = VerdictStatus.STALE
    assert send(recorder, append_requests(0)) == ["ok", "stale"]
    coordinator.verdicts[1] = VerdictStatus.DONE
    assert send(recorder, append_requests(1)) == ["ok", "dup"]
    recorder.close()
    assert names(tmp_path) == []


def test_absent_coordinator_is_answered_with_retry(make_recorder, coordinator, tmp_path) -> None:
    coordinator.go_away()
    coordinator.away.discard("expect")
    recorder = make_recorder()
    first, last = append_requests(0)
    assert send(recorder, [first, last, last]) == ["ok", "retry", "retry"]
    assert list(tmp_path.glob("shard-*")) == []
    coordinator.away.clear()
    assert send(recorder, [last]) == ["committed"]


def test_grant_whose_answer_is_lost_is_still_used(make_recorder, coordinator) -> None:
    recorder = make_recorder()
    coordinator.away = {"grant-reply"}
    assert send(recorder, append_requests(0)) == ["ok", "retry"]
    coordinator.away.clear()
    # The sender died: the recorder finds the grant among the pending ones by itself.
    assert recorder.settle()
    assert coordinator.done_indices == [0]
    assert coordinator.granted == {}


def test_report_is_sent_until_it_is_acknowledged(make_recorder, coordinator) -> None:
    recorder = make_recorder()
    coordinator.away = {"done"}
    assert send(recorder, append_requests(0)) == ["ok", "committed"]
    assert not recorder.settle()
    coordinator.away.clear()
    assert recorder.settle()
    assert recorder.settle()
    assert coordinator.done_indices == [0]


def test_episode_given_away_after_its_grant_is_an_error(make_recorder, coordinator) -> None:
    recorder = make_recorder()
    coordinator.stale_done = {0}
    with pytest.raises(RunError, match="the coordinator does not count it"):
        send(recorder, append_requests(0))


def test_full_disk_cuts_the_shard_back_and_names_the_folder(make_recorder, coordinator, tmp_path, monkeypatch) -> None:
    recorder = make_recorder()
    send(recorder, append_requests(0))
    part = tmp_path / "shard-r0-00000.mcap.part"
    good = part.read_bytes()
    real_write = os.write

    def write_half(descriptor: int, data: memoryview) -> int:
        if len(data) < 5000:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real_write(descriptor, data[: len(data) // 2])

    monkeypatch.setattr("readygo.common.dataset.writer.os.write", write_half)
    monkeypatch.setattr("readygo.services.recorder.handlers.FULL_S", 60.0)
    assert send(recorder, append_requests(1)) == ["ok", "retry"]
    assert part.read_bytes() == good
    assert coordinator.lost == []
    assert coordinator.troubles == [f"No space left in {tmp_path}; free some, and recording continues."]
    last = append_requests(1)[-1]
    assert handle_append(recorder, last) == AppendReply(status=AppendStatus.RETRY, detail=coordinator.troubles[0])
    assert len(coordinator.troubles) == 1, "it is not tried all the time"
    with pytest.raises(DiskError, match="No space left"):
        recorder.close()
    assert part.read_bytes() == good
    monkeypatch.undo()

    crash(recorder)
    resumed = make_recorder()
    assert resumed.settle()
    assert [report.index for report in coordinator.lost] == [1]
    assert send(resumed, append_requests(1, attempt=2)) == ["ok", "committed"]
    resumed.close()
    assert [entry.episode.index for entry in Dataset([tmp_path]).episodes] == [0, 1]
    assert validate(tmp_path).defects == ()


@pytest.mark.parametrize("cut", [True, False], ids=["cut back", "not even cut back"])
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
def test_disk_that_takes_nothing_is_waited_for(make_recorder, coordinator, tmp_path, monkeypatch, code, cut) -> None:
    monkeypatch.setattr("readygo.services.recorder.handlers.FULL_S", 0.0)
    recorder = make_recorder()
    send(recorder, append_requests(0))

    def refuse(*arguments: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("readygo.common.dataset.writer.os.write", refuse)
    if not cut:
        monkeypatch.setattr("readygo.common.dataset.writer.os.ftruncate", refuse)
    assert send(recorder, append_requests(1)) == ["ok", "retry"]
    assert not recorder.settle()
    assert send(recorder, append_requests(2)) == ["ok", "retry"]
    assert coordinator.lost == []
    monkeypatch.undo()
    monkeypatch.setattr("readygo.services.recorder.handlers.FULL_S", 0.0)
    # Nobody sends the first one again: its worker has ended meanwhile.
    assert recorder.settle()
    assert coordinator.troubles[-1] == ""
    assert handle_append(recorder, append_requests(2)[-1]).status.value in ("committed", "dup")
    assert {*coordinator.done_indices} == {0, 1, 2}
    recorder.close()
    assert sorted(entry.episode.index for entry in Dataset([tmp_path]).episodes) == [0, 1, 2]
    assert validate(tmp_path).defects == ()


def test_longest_untouched_buffer_goes_first(make_recorder) -> None:
    recorder = make_recorder()
    requests = {index: append_requests(index, 20) for index in range(3)}
    batch_bytes = sum(len(sample.image) for sample in requests[0][0].samples)
    recorder._buffers._limit_bytes = int(2.5 * batch_bytes)
    assert [handle_append(recorder, requests[index][0]).status.value for index in (0, 1, 2)] == ["ok"] * 3
    assert handle_append(recorder, requests[0][1]) == AppendReply(status=AppendStatus.GAP, expected_seq=0)
    assert handle_append(recorder, requests[2][1]).status is AppendStatus.OK


def test_an_episode_larger_than_the_bound_is_still_recorded(make_recorder) -> None:
    recorder = make_recorder()
    recorder._buffers._limit_bytes = 100
    assert send(recorder, append_requests(0, 20)) == ["ok", "ok", "committed"]


def test_name_must_fit_a_topic(make_recorder) -> None:
    with pytest.raises(RunError, match="letters, digits and underscores"):
        make_recorder("a/b")


def test_provenance_that_cannot_be_recorded_is_refused_at_the_start(tmp_path) -> None:
    with pytest.raises(DatasetError, match="must be plain values"):
        Recorder(tmp_path, "r0", InProcessBus(), Provenance(config={"robot": tmp_path}))
    assert list(tmp_path.iterdir()) == []


def test_episode_of_another_run_is_refused(make_recorder) -> None:
    recorder = make_recorder()
    send(recorder, append_requests(0))
    recorder.close()
    other = append_requests(1, episode=EpisodeKey(seed=8, split=Split.TRAIN, index=1))
    with pytest.raises(RunError, match="holds train episodes of seed 7, got train-8-000001"):
        send(make_recorder(), other)


def test_samples_of_an_attempt_that_nobody_leased_change_nothing(make_recorder, coordinator, tmp_path) -> None:
    recorder = make_recorder()
    coordinator.unexpected = {0: VerdictStatus.STALE}
    forged = append_requests(0, attempt=10**9, episode=EpisodeKey(seed=999, split=Split.TRAIN, index=0))
    reply = handle_append(recorder, forged[0])
    assert (reply.status, reply.detail) == (AppendStatus.STALE, "nobody leased it")
    coordinator.unexpected = {}
    assert send(recorder, append_requests(0)) == ["ok", "committed"]
    coordinator.unexpected = {1: VerdictStatus.DONE}
    assert send(recorder, append_requests(1)) == ["dup", "dup"]
    coordinator.go_away()
    assert send(recorder, append_requests(2)) == ["retry", "retry"]


def test_another_holder_of_the_same_attempt_proves_its_lease_before_its_samples_are_taken(
    make_recorder, coordinator, tmp_path
) -> None:
    recorder = make_recorder()
    first, last = (dataclasses.replace(request, lease="ours") for request in append_requests(0))
    assert send(recorder, [first]) == ["ok"]
    coordinator.unexpected = {0: VerdictStatus.STALE}
    for attempt in (1, 2):
        forged = dataclasses.replace(last, lease="theirs", attempt=attempt)
        assert send(recorder, [forged]) == ["stale"], "nobody leased it to them"
    assert send(recorder, [dataclasses.replace(last, lease="")]) == ["stale"]
    assert recorder.state().buffered_episodes == 1
    assert send(recorder, [dataclasses.replace(last, lease="ours", samples=(*last.samples,))]) == ["committed"]
    assert coordinator.done_indices == [0]
    recorder.close()
    assert validate(tmp_path).defects == ()


def test_recorder_that_leaves_reports_nothing_and_the_next_one_of_its_name_goes_on(
    make_recorder, coordinator, tmp_path
) -> None:
    first = make_recorder()
    assert send(first, append_requests(0)) == ["ok", "committed"]
    coordinator.granted[1] = 1
    first.leave()
    assert handle_append(first, append_requests(1)[0]).status is AppendStatus.RETRY
    assert coordinator.lost == []
    again = make_recorder()
    assert again.settle()
    again.close()
    again.leave()
    assert names(tmp_path) == ["shard-r0-00000.index", "shard-r0-00000.mcap"]
    assert set(coordinator.done_indices) == {0}


def test_folder_that_cannot_be_made_is_said_in_one_line(coordinator, tmp_path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match=r"Writing to .*file/data failed: Not a directory"):
        Recorder(tmp_path / "file" / "data", "r0", coordinator.bus, Provenance())


def test_closed_recorder_asks_to_try_again(make_recorder) -> None:
    recorder = make_recorder()
    recorder.close()
    assert send(recorder, append_requests(0)) == ["retry", "retry"]


def test_interleaved_senders_in_threads_all_commit(make_recorder, coordinator, tmp_path) -> None:
    recorder = make_recorder()
    threads = [threading.Thread(target=send, args=(recorder, append_requests(index))) for index in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    recorder.close()
    assert sorted(coordinator.done_indices) == list(range(6))
    assert validate(tmp_path).episode_count == 6


def test_output_that_is_damaged_on_its_way_is_asked_for_again(make_recorder) -> None:
    recorder = make_recorder()
    first, last = append_requests(0, outputs=("depth",))
    sample = first.samples[3]
    damaged = dataclasses.replace(sample, outputs={"depth": sample.outputs["depth"][:-1] + b"x"})
    samples = (*first.samples[:3], damaged, *first.samples[4:])
    reply = handle_append(recorder, dataclasses.replace(first, samples=samples))
    assert (reply.status.value, reply.expected_seq) == ("gap", 3)
    assert send(recorder, [first, last]) == ["ok", "committed"]


def test_episodes_that_others_record_meanwhile_are_dropped_and_the_disk_is_tried_again(
    make_recorder, coordinator, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr("readygo.services.recorder.handlers.FULL_S", 0.0)
    recorder = make_recorder()
    coordinator.others_take_over = True

    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("readygo.common.dataset.writer.os.write", refuse)
    monkeypatch.setattr("pathlib.Path.write_bytes", refuse)
    assert send(recorder, append_requests(0)) == ["ok", "retry"]
    coordinator.granted.clear()
    assert not recorder.settle(), "nothing waits for the disk any more, but it is still full"
    coordinator.unexpected[0] = VerdictStatus.STALE
    assert handle_append(recorder, append_requests(0)[-1]).status is AppendStatus.STALE
    monkeypatch.undo()
    monkeypatch.setattr("readygo.services.recorder.handlers.FULL_S", 0.0)
    assert recorder.settle()
    assert coordinator.troubles[-1] == ""
    assert coordinator.lost == []
    assert list(tmp_path.glob(".room*")) == []
    recorder.close()
