import dataclasses

import numpy as np
import pytest

from readygo.common.errors import DatasetError
from readygo.common.messages import AppendStatus
from readygo.services.recorder.buffers import DAMAGED_MAX, EpisodeBuffers
from tests.common.dataset.episodes import append_requests


def episode_bytes(index: int) -> int:
    return sum(sample.images_size_bytes for request in append_requests(index) for sample in request.samples)


def buffers(episodes: float = 100.0) -> EpisodeBuffers:
    """Buffers with room for so many episodes of 12 samples."""
    return EpisodeBuffers(int(episodes * episode_bytes(0) * 1.2))


def damaged(request, number):
    """The request with one sample whose image does not match its checksum."""
    samples = list(request.samples)
    samples[number] = dataclasses.replace(samples[number], crc32=samples[number].crc32 ^ 1)
    return dataclasses.replace(request, samples=tuple(samples))


def test_batches_make_a_complete_episode() -> None:
    kept = buffers()
    for request in append_requests(3):
        assert kept.add(request).status is AppendStatus.OK
    buffer = kept.get(3)
    assert buffer is not None
    assert buffer.complete
    assert [sample.seq for sample in buffer.samples] == list(range(12))


def test_batch_that_comes_twice_or_overlaps_is_taken_once() -> None:
    kept = buffers()
    first, second = append_requests(0)
    for request in (first, first, dataclasses.replace(second, first_seq=8), second):
        assert kept.add(request).status is AppendStatus.OK
    assert len(kept.get(0).samples) == 12


def test_gap_names_the_sample_that_is_due() -> None:
    kept = buffers()
    first, second = append_requests(0)
    assert (kept.add(second).status, kept.add(second).expected_seq) == (AppendStatus.GAP, 0)
    kept.add(first)
    assert kept.add(second).status is AppendStatus.OK


def test_newer_attempt_replaces_an_older_one_which_is_stale_then() -> None:
    kept = buffers()
    kept.add(append_requests(0)[0])
    assert kept.add(append_requests(0, attempt=2)[0]).status is AppendStatus.OK
    assert kept.add(append_requests(0)[1]).status is AppendStatus.STALE
    assert (kept.get(0).attempt, len(kept.get(0).samples)) == (2, 8)
    assert kept.add(append_requests(0, attempt=2)[1]).status is AppendStatus.OK
    assert kept.get(0).complete


def test_damaged_sample_is_asked_for_again_a_few_times_only() -> None:
    kept = buffers()
    request = append_requests(0)[0]
    assert DAMAGED_MAX == 3
    for _ in range(3):
        reply = kept.add(damaged(request, 5))
        assert (reply.status, reply.expected_seq) == (AppendStatus.GAP, 5)
    with pytest.raises(DatasetError, match="never matches"):
        kept.add(damaged(request, 5))


def test_longest_untouched_buffer_makes_room() -> None:
    kept = buffers(2)
    for index in (0, 1):
        for request in append_requests(index):
            kept.add(request)
    kept.add(append_requests(0)[0])
    for request in append_requests(2):
        kept.add(request)
    assert kept.get(1) is None
    assert kept.get(0).complete
    assert kept.get(2).complete


def test_bound_in_bytes_may_be_reached_and_not_passed() -> None:
    for spare, left in ((0, [0, 1]), (-1, [1])):
        kept = EpisodeBuffers(sum(episode_bytes(index) for index in (0, 1)) + spare)
        for index in (0, 1):
            for request in append_requests(index):
                kept.add(request)
        assert [index for index in (0, 1) if kept.get(index)] == left
        assert (kept.count, kept.size_bytes) == (len(left), sum(map(episode_bytes, left)))
    kept.clear()
    assert (kept.count, kept.size_bytes) == (0, 0)


def test_lease_header_and_attempt_are_those_of_the_first_batch() -> None:
    kept = buffers()
    first = dataclasses.replace(append_requests(5, attempt=3)[0], lease="proof")
    kept.add(first)
    buffer = kept.get(5)
    assert (buffer.attempt, buffer.lease, buffer.header) == (3, "proof", first.header)
    assert not buffer.complete
    kept.drop(5)
    kept.drop(5)
    assert kept.get(5) is None


def test_batches_of_any_cut_and_overlap_make_the_same_episode() -> None:
    first, second = append_requests(4)
    samples, rng = (*first.samples, *second.samples), np.random.default_rng(5)
    for _ in range(20):
        kept, due = buffers(), 0
        while due < 12:
            begin = int(rng.integers(0, min(due + 3, 12)))
            end = int(rng.integers(begin + 1, 13))
            batch = dataclasses.replace(first, first_seq=begin, samples=samples[begin:end], last=end == 12)
            reply = kept.add(batch)
            if begin > due:
                assert (reply.status, reply.expected_seq) == (AppendStatus.GAP, due)
            else:
                assert reply.status is AppendStatus.OK
                due = max(due, end)
            assert [sample.seq for sample in kept.get(4).samples] == list(range(due))
        assert kept.get(4).size_bytes == episode_bytes(4)


def test_sample_behind_the_last_one_is_refused() -> None:
    kept = buffers()
    first, second = append_requests(0)
    kept.add(first)
    kept.add(second)
    more = dataclasses.replace(second.samples[-1], seq=12)
    with pytest.raises(DatasetError, match="sent sample 12 where 12 was due"):
        kept.add(dataclasses.replace(second, samples=(*second.samples, more)))


def test_episode_larger_than_all_room_is_kept_while_it_comes_in() -> None:
    kept = buffers(0.1)
    for request in append_requests(0):
        assert kept.add(request).status is AppendStatus.OK
    assert kept.get(0).complete
    kept.add(append_requests(1)[0])
    assert kept.get(0) is None
    assert kept.get(1) is not None


def test_sender_that_contradicts_itself_is_refused() -> None:
    kept = buffers()
    first, second = append_requests(0)
    kept.add(first)
    other = dataclasses.replace(second, header=dataclasses.replace(second.header, goal_xy_m=(0.0, 0.0)))
    with pytest.raises(DatasetError, match="two different headers"):
        kept.add(other)
    with pytest.raises(DatasetError, match="closed after 11 of 12"):
        kept.add(dataclasses.replace(second, samples=second.samples[:3]))


def test_memory_bound_counts_outputs() -> None:
    buffers = EpisodeBuffers(limit_bytes=2**20)
    request = append_requests(0, outputs=("depth", "normal"))[0]
    buffers.add(request)
    buffer = buffers.get(0)
    assert buffer is not None
    assert buffer.size_bytes == sum(len(s.image) + sum(map(len, s.outputs.values())) for s in request.samples)
