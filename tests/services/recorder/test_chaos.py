import os
import random
from pathlib import Path

import pytest

from readygo.common.dataset import Dataset, encode_episode, validate
from readygo.common.errors import BusError
from readygo.common.messages import AppendStatus, GrantRequest, Verdict, VerdictStatus
from readygo.services.recorder import Recorder, RecorderConfig, handle_append
from tests.common.dataset.episodes import PROVENANCE, append_requests, make_episode
from tests.services.recorder.by_hand import crash
from tests.services.recorder.coordinator import FakeCoordinator

EPISODES, SAMPLES = 12, 10


class PowerCut(BaseException):
    """The process is gone, in the middle of a write."""


class LeasingCoordinator(FakeCoordinator):
    """Fences by attempt and loses requests and answers at random."""

    def __init__(self, rng: random.Random) -> None:
        super().__init__()
        self.rng = rng
        self.attempts = dict.fromkeys(range(EPISODES), 0)

    def lease(self, index: int) -> int:
        self.attempts[index] += 1
        return self.attempts[index]

    def _answer(self, topic: str) -> None:
        if self.rng.random() < 0.15:
            raise BusError(f"Nobody answered {topic}.")

    def _grant(self, request: GrantRequest) -> Verdict:
        if request.index not in self.done_indices and request.attempt != self.attempts[request.index]:
            return Verdict(status=VerdictStatus.STALE)
        return super()._grant(request)


class Site:
    """A folder with a recorder that is killed and started again."""

    def __init__(self, folder: Path, rng: random.Random, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = folder
        self.rng = rng
        self.coordinator = LeasingCoordinator(rng)
        self.cut_count = 0
        self._write = os.write
        monkeypatch.setattr("readygo.common.dataset.writer.os.write", self._fragile_write)
        self.recorder = self._start()

    def _start(self) -> Recorder:
        config = RecorderConfig(fsync=False, episodes_per_shard=4)
        return Recorder(self.folder, "r0", self.coordinator.bus, PROVENANCE, config)

    def _fragile_write(self, descriptor: int, data: memoryview) -> int:
        if self.rng.random() < 0.2:
            self._write(descriptor, data[: self.rng.randrange(len(data) + 1)])
            raise PowerCut
        return self._write(descriptor, data)

    def restart(self) -> None:
        self.cut_count += 1
        crash(self.recorder)
        self.recorder = self._start()

    def send(self, index: int) -> None:
        """One worker's try at an episode; the worker may die, too."""
        attempt = self.coordinator.lease(index)
        requests = append_requests(index, SAMPLES, attempt=attempt, batch=4)
        position = 0
        for _ in range(20):
            if self.rng.random() < 0.05:
                return
            try:
                reply = handle_append(self.recorder, requests[position])
            except PowerCut:
                self.restart()
                continue
            if reply.status in (AppendStatus.COMMITTED, AppendStatus.DUP, AppendStatus.STALE):
                return
            if reply.status is AppendStatus.GAP:
                position = reply.expected_seq // 4
            elif reply.status is AppendStatus.OK:
                position += 1

    def open_episodes(self) -> list[int]:
        return [i for i in range(EPISODES) if i not in self.coordinator.done_indices]

    def drain(self) -> None:
        for _ in range(100):
            try:
                if self.recorder.settle():
                    return
            except PowerCut:
                self.restart()

    def close(self) -> None:
        while True:
            self.drain()
            try:
                self.recorder.close()
                return
            except PowerCut:
                self.restart()


@pytest.mark.parametrize("seed", range(8))
def test_every_episode_is_recorded_exactly_once_whatever_dies(tmp_path, monkeypatch, seed) -> None:
    rng = random.Random(seed)
    site = Site(tmp_path, rng, monkeypatch)
    for _ in range(300):
        todo = [index for index in site.open_episodes() if index not in site.coordinator.granted]
        if todo:
            site.send(rng.choice(todo))
        elif site.open_episodes():
            site.drain()
        else:
            break
    assert site.open_episodes() == []
    site.close()
    report = validate(tmp_path)
    assert report.defects == ()
    assert report.notes == ()
    dataset = Dataset([tmp_path])
    assert [entry.episode.index for entry in dataset.episodes] == list(range(EPISODES))
    want = [encode_episode(header, 1, samples) for header, samples in map(_episode, range(EPISODES))]
    assert [entry.sha256 for entry in dataset.episodes] == [chunk.sha256 for chunk in want]
    assert site.cut_count > 0


def _episode(index: int):
    return make_episode(index, SAMPLES)
