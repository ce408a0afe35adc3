"""The real coordinator with two real recorders, over a network that loses and repeats what is said, and liars."""

import dataclasses
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.dataset import Dataset, validate
from readygo.common.errors import BusError
from readygo.common.messages import (
    AppendRequest,
    AppendStatus,
    ClaimReply,
    ClaimStatus,
    DoneRequest,
    GrantRequest,
    LostRequest,
    VerdictStatus,
    topics,
)
from readygo.common.messages.stages import HUMAN_PLAN, Stage
from readygo.services.coordinator.upkeep import requeue_lost
from readygo.services.recorder import Recorder, RecorderConfig, handle_append
from tests.common.dataset.episodes import PROVENANCE, append_requests
from tests.services.coordinator.line import Line
from tests.services.recorder.by_hand import crash

FILM = Stage(name="film", role="camera", records=True)
LINE = (HUMAN_PLAN, FILM)
RECORDERS = ("rec0", "rec1")
WANTED, SAMPLES, REJECTED = 8, 6, frozenset({2, 5})


class LossyBus(InProcessBus):
    """Loses requests and replies, and sends earlier requests again."""

    def __init__(self, beside: InProcessBus, rng: random.Random) -> None:
        super().__init__(beside)
        self._rng = rng
        self._sent: list[Callable[[], object]] = []

    def request(self, topic, request, *, timeout_s: float = 5.0):
        if self._sent and self._rng.random() < 0.2:
            self._rng.choice(self._sent)()
        if self._rng.random() < 0.1:
            raise BusError(f"Nobody answered {topic.name}.")
        self._sent.append(lambda: InProcessBus.request(self, topic, request))
        reply = super().request(topic, request)
        if self._rng.random() < 0.1:
            raise BusError(f"Nobody answered {topic.name}.")
        return reply


class Site:
    """A run with two recorders, whose workers and recorders end now and then."""

    def __init__(self, folder: Path, rng: random.Random) -> None:
        self.rng, self.folder = rng, folder
        self.line = Line(folder / "run", wanted=WANTED, stages=LINE, recorders=RECORDERS)
        spec = self.line.coordinator.spec
        self.line.coordinator.spec = dataclasses.replace(spec, seed=7)
        self.recorders = {name: self._start(name) for name in RECORDERS}
        self.crashes = self.refused = 0

    def _start(self, name: str) -> Recorder:
        bus = LossyBus(self.line.bus, self.rng)
        return Recorder(self.folder / name, name, bus, PROVENANCE, RecorderConfig(fsync=False, episodes_per_shard=3))

    def restart(self, name: str) -> None:
        self.crashes += 1
        crash(self.recorders[name])
        self.recorders[name] = self._start(name)

    def step(self) -> None:
        """One thing that happens."""
        for _ in range(3):
            self._lie()
        chance = self.rng.random()
        if chance < 0.1:
            self.restart(self.rng.choice(RECORDERS))
        elif chance < 0.2:
            self.line.now_s += self.rng.choice((1.0, 20.0))
            requeue_lost(self.line.coordinator)
        else:
            self._plan()
            self._film()
        for recorder in self.recorders.values():
            recorder.settle()

    def _plan(self) -> None:
        claim = self.line.claim(HUMAN_PLAN)
        if claim.episode is not None:
            rejected = "no path" if claim.episode.index in REJECTED else ""
            self.line.complete(HUMAN_PLAN, claim, result=b"plan", rejected=rejected)

    def _film(self) -> None:
        """A worker records an episode, unless it ends on the way."""
        claim = self.line.claim(FILM)
        if claim.status is not ClaimStatus.LEASE:
            return
        requests = self._samples(claim)
        position = 0
        for _ in range(30):
            if self.rng.random() < 0.05:
                return
            reply = handle_append(self.recorders[claim.recorder], requests[position])
            if reply.status in (AppendStatus.COMMITTED, AppendStatus.DUP, AppendStatus.STALE):
                return
            if reply.status is AppendStatus.GAP:
                position = reply.expected_seq // 2
            elif reply.status is AppendStatus.OK:
                position += 1

    def _samples(self, claim: ClaimReply) -> list[AppendRequest]:
        assert claim.episode is not None
        requests = append_requests(claim.episode.index, SAMPLES, attempt=claim.attempt, batch=2)
        return [dataclasses.replace(request, lease=claim.lease) for request in requests]

    def _lie(self) -> None:
        """A recorder, or a process that is none, reports what it likes."""
        index, attempt = self.rng.randrange(WANTED + 4), self.rng.randrange(6)
        granted = {name: self.line.coordinator.ledger.census.granted_attempts(name) for name in RECORDERS}
        recorder = self.rng.choice((*RECORDERS, "rec2"))
        if granted.get(recorder, {}).get(index) == attempt or index in self._durable(recorder):
            return
        lies = (
            (topics.DONE, DoneRequest(recorder=recorder, index=index, attempt=attempt, shard="s", sample_count=9)),
            (topics.LOST, LostRequest(recorder=recorder, index=index, attempt=attempt, reason="")),
        )
        topic, lie = self.rng.choice(lies)
        verdict = self.line.bus.request(topic, lie)
        if isinstance(lie, DoneRequest):
            assert verdict.status is VerdictStatus.STALE
            self.refused += 1
        else:
            assert verdict.status is VerdictStatus.OK

    def _durable(self, recorder: str) -> set[int]:
        return set(self.recorders[recorder]._shards.durable) if recorder in self.recorders else set()

    def close(self) -> None:
        for recorder in self.recorders.values():
            while not recorder.settle():
                pass
            recorder.close()


@pytest.mark.parametrize("seed", range(12))
def test_smallest_accepted_indices_are_recorded_once_each(tmp_path: Path, seed: int) -> None:
    (tmp_path / "run").mkdir()
    site = Site(tmp_path, random.Random(seed))
    for _ in range(2_000):
        site.step()
        if site.line.coordinator.finished:
            break
    site.close()
    assert site.line.coordinator.finished
    places = [tmp_path / name for name in RECORDERS]
    used = [place for place in places if any(place.glob("*.mcap"))]
    found = sorted(entry.episode.index for place in used for entry in Dataset([place]).episodes)
    accepted = [index for index in range(20) if index not in REJECTED]
    assert found == accepted[:WANTED]
    assert all(validate(place).ok for place in used)
    assert site.line.status().rejected == {"no path": len(REJECTED)}
    assert site.refused > 0


def test_unknown_recorder_is_granted_nothing(tmp_path: Path) -> None:
    line = Line(tmp_path, wanted=1, stages=LINE, recorders=RECORDERS)
    line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN), result=b"plan")
    claim = line.claim(FILM)
    assert claim.episode is not None
    for recorder in ("rec1", "rec2"):
        request = GrantRequest(recorder=recorder, index=claim.episode.index, attempt=claim.attempt)
        assert line.bus.request(topics.GRANT, request).status is VerdictStatus.STALE
