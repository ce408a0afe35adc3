"""An exhaustive explorer of the protocol between workers, recorders and the coordinator.

The coordinator's part is `Protocol` itself, the code that `Ledger` runs. Workers and recorders are small models of
`common/fleet` and `services/recorder`. The network may lose, delay, reorder and repeat every message: a message that
was sent once can be delivered at any later time, any number of times, or never. Two processes are hostile within what
their certificates allow: a worker of another role announces and withdraws any name, and each recorder reports anything
about itself.

The run wants the smallest accepted indices of a line of two stages; index 0 is rejected by the first stage. A state
is all that anyone knows; `explore` visits every state that can be reached within the bounds and checks each.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

from readygo.common.messages import Stage, VerdictStatus
from readygo.services.coordinator.protocol import EpisodeRow, Holder, Protocol, StageState, Written

PLAN, FILM = Stage(name="plan", role="planner"), Stage(name="film", role="camera", records=True)
RECORDERS = ("r0", "r1")
DEATHS_MAX = 2
REJECTED = frozenset({0})
"""Indices that the first stage rejects."""

Message = tuple[str, str, int, int]
"""Kind, recorder (empty for one of a worker), index and attempt."""


@dataclass(frozen=True, slots=True)
class World:
    """What everyone knows, and what was sent."""

    episodes: tuple[EpisodeRow, ...]
    sent: frozenset[Message]
    """Messages of recorders that are on their way, or were delivered and may be again."""
    disks: tuple[frozenset[tuple[int, int]], ...]
    """Index and attempt of what is in shards, by recorder."""
    crashes: int
    deaths: int
    """Lives of workers that really ended so far."""


@dataclass(frozen=True)
class Bounds:
    """How far to explore."""

    wanted: int = 1
    """Episodes of the run."""
    attempts: int = 3
    """Leases of an episode."""
    crashes: int = 1
    """Recorders that end between writing and reporting."""
    deaths: int = 1
    """Workers that end while they hold a lease."""

    @property
    def expected(self) -> frozenset[int]:
        """What the committed set must be in the end: the smallest indices that are not rejected."""
        accepted = (index for index in itertools.count() if index not in REJECTED)
        return frozenset(itertools.islice(accepted, self.wanted))


@dataclass(frozen=True)
class Found:
    """What an exploration has seen."""

    states: int
    transitions: int
    finished: int
    """States in which the run is finished."""
    violations: tuple[str, ...]
    stuck: int
    """States from which the run can be finished no more, of those that have attempts left."""


def explore(protocol: Protocol, bounds: Bounds, *, violations_max: int = 1) -> Found:
    """Visit every state within the bounds, breadth first."""
    begin = World(_opened(protocol, (), bounds), frozenset(), (frozenset(), frozenset()), 0, 0)
    seen: dict[World, int] = {begin: 0}
    parents: list[list[int]] = [[]]
    worlds = [begin]
    violations: list[str] = []
    transitions = finished = 0
    for number, world in enumerate(worlds):
        violations += _violations(world, bounds)
        finished += _is_finished(world, bounds)
        if len(violations) >= violations_max:
            break
        for following in _steps(protocol, world, bounds):
            transitions += 1
            # One look-up: to hash a world takes longer than to make it.
            place = seen.setdefault(following, len(worlds))
            if place == len(worlds):
                worlds.append(following)
                parents.append([])
            parents[place].append(number)
    stuck = 0 if violations else _stuck(worlds, parents, bounds)
    return Found(len(seen), transitions, finished, tuple(violations), stuck)


def _opened(protocol: Protocol, episodes: tuple[EpisodeRow, ...], bounds: Bounds) -> tuple[EpisodeRow, ...]:
    """Indices are opened until the wanted number of them is not rejected, as by `Ledger.open_episodes`."""
    while sum(episode.state is not StageState.REJECTED for episode in episodes) < bounds.wanted:
        episodes = (*episodes, EpisodeRow(index=len(episodes), stage=protocol.first))
    return episodes


def _is_finished(world: World, bounds: Bounds) -> bool:
    return sum(episode.state is StageState.COMMITTED for episode in world.episodes) >= bounds.wanted


def _violations(world: World, bounds: Bounds) -> Iterator[str]:
    for episode in world.episodes:
        if episode.state is StageState.COMMITTED:
            if episode.index not in bounds.expected:
                yield f"{episode.index} is committed in place of one of {sorted(bounds.expected)}"
            if not _has(world, episode.recorder, episode.index):
                yield f"{episode.index} is committed and not in a shard of {episode.recorder}"
        if episode.state is StageState.REJECTED and episode.index not in REJECTED:
            yield f"{episode.index} is given up: {episode.reason}"
    if _is_finished(world, bounds):
        for index in bounds.expected:
            copies = sum(_has(world, recorder, index) for recorder in RECORDERS)
            if copies != 1:
                yield f"{index} is in {copies} shards at the end"


def _steps(protocol: Protocol, world: World, bounds: Bounds) -> Iterator[World]:
    if not _is_finished(world, bounds):
        yield from _claims(protocol, world, bounds)
    for episode in world.episodes:
        if episode.state is StageState.LEASED:
            yield from _work(protocol, world, episode, bounds)
            yield from _forged_departures(protocol, world, episode, bounds)
    yield from _recorders(protocol, world, bounds)
    for message in world.sent:
        yield from _delivered(protocol, bounds, world, message)
    yield from _forged_reports(protocol, world, bounds)


def _changed(protocol: Protocol, bounds: Bounds, world: World, episode: EpisodeRow | None) -> Iterator[World]:
    """The world with a changed episode; nothing where the protocol refused."""
    if episode is not None:
        episodes = (*world.episodes[: episode.index], episode, *world.episodes[episode.index + 1 :])
        yield replace(world, episodes=_opened(protocol, episodes, bounds))


def _claims(protocol: Protocol, world: World, bounds: Bounds) -> Iterator[World]:
    """Each worker may claim the smallest waiting episode of a stage; the reply may be lost, then the lease expires."""
    for stage in (PLAN, FILM):
        waiting = (e for e in world.episodes if e.state is StageState.WAITING and e.stage == stage.name)
        episode = next(waiting, None)
        if episode is None or episode.attempt >= bounds.attempts:
            continue
        holder = Holder(worker="desk-1", role=stage.role, session="1")
        for recorder in RECORDERS if stage.records else ("",):
            yield from _changed(protocol, bounds, world, protocol.lease(episode, holder, recorder))


def _work(protocol: Protocol, world: World, episode: EpisodeRow, bounds: Bounds) -> Iterator[World]:
    """The holder completes, sends its samples, or ends; the lease may run out at any time."""
    if episode.stage == protocol.first:
        yield _send(world, ("complete", "", episode.index, episode.attempt))
    else:
        # All samples have come to the recorder, which asks whether it may write them.
        yield _send(world, ("grant", episode.recorder, episode.index, episode.attempt))
    yield from _changed(protocol, bounds, world, protocol.expire(episode))
    if world.deaths < bounds.deaths:
        for after in _changed(protocol, bounds, world, protocol.lose_holder(episode, episode.holder)):
            yield _after_death(protocol, bounds, replace(after, deaths=world.deaths + 1), episode.index)


def _forged_departures(protocol: Protocol, world: World, episode: EpisodeRow, bounds: Bounds) -> Iterator[World]:
    """Another role's process of the same name ends, and so does an earlier life of the worker."""
    holder = episode.holder
    for forged in (replace(holder, role="other"), replace(holder, session="0"), replace(holder, session="")):
        for after in _changed(protocol, bounds, world, protocol.lose_holder(episode, forged)):
            yield _after_death(protocol, bounds, after, episode.index)


def _after_death(protocol: Protocol, bounds: Bounds, world: World, index: int) -> World:
    """What `upkeep` does then."""
    episode = world.episodes[index]
    if episode.deaths < DEATHS_MAX:
        return world
    (after,) = _changed(protocol, bounds, world, protocol.set_aside(episode, "workers ended"))
    return after


def _send(world: World, message: Message) -> World:
    return replace(world, sent=world.sent | {message})


def _recorders(protocol: Protocol, world: World, bounds: Bounds) -> Iterator[World]:
    """What recorders do with the answers that they got: "granted" and "refused"."""
    for answer in world.sent:
        kind, recorder, index, attempt = answer
        if kind not in ("granted", "refused"):
            continue
        durable = _has(world, recorder, index)
        if kind == "granted" and not durable and ("lost", *answer[1:]) not in world.sent:
            written = _with_disk(world, recorder, _disk(world, recorder) | {(index, attempt)})
            yield _send(written, ("done", *answer[1:]))
            # It ends before it could write, and finds at its next start that it holds a grant without an episode.
            yield _send(world, ("lost", *answer[1:]))
            if world.crashes < bounds.crashes:
                # It ends after it wrote; its next start finds the open shard, and asks for the grant again.
                yield _send(replace(written, crashes=world.crashes + 1), ("grant", *answer[1:]))
        elif kind == "granted" and durable:
            # Salvaged, or another attempt at an episode that it has: reported under the attempt that is granted.
            yield _send(world, ("done", *answer[1:]))
        elif (index, attempt) in _disk(world, recorder) and ("done", *answer[1:]) not in world.sent:
            # A salvaged episode that is not its own is left out.
            yield _with_disk(world, recorder, _disk(world, recorder) - {(index, attempt)})
    for recorder in RECORDERS:
        yield from _trouble(protocol, world, recorder)


def _trouble(protocol: Protocol, world: World, recorder: str) -> Iterator[World]:
    """A recorder's disk takes nothing: others take over what it has not reported; it forgets what it was granted."""
    committed = {e.index for e in world.episodes if e.state is StageState.COMMITTED and e.recorder == recorder}
    if any(index not in committed for index, _ in _disk(world, recorder)):
        # It reports what is durable first.
        return
    taken = [(protocol.take_from(episode, recorder) or episode) for episode in world.episodes]
    if taken != list(world.episodes):
        sent = frozenset(message for message in world.sent if message[:2] != ("granted", recorder))
        yield replace(world, episodes=tuple(taken), sent=sent)


def _disk(world: World, recorder: str) -> frozenset[tuple[int, int]]:
    return world.disks[RECORDERS.index(recorder)]


def _has(world: World, recorder: str, index: int) -> bool:
    return any(durable == index for durable, _ in _disk(world, recorder))


def _with_disk(world: World, recorder: str, disk: frozenset[tuple[int, int]]) -> World:
    disks = tuple(disk if name == recorder else old for name, old in zip(RECORDERS, world.disks, strict=True))
    return replace(world, disks=disks)


def _delivered(protocol: Protocol, bounds: Bounds, world: World, message: Message) -> Iterator[World]:
    kind, recorder, index, attempt = message
    episode = world.episodes[index]
    if kind == "complete" and index in REJECTED:
        yield from _changed(protocol, bounds, world, protocol.reject(episode, PLAN.name, attempt, "no path"))
    elif kind == "complete":
        yield from _changed(protocol, bounds, world, protocol.advance(episode, PLAN.name, attempt))
    elif kind == "grant":
        granted, verdict = protocol.grant(episode, recorder, attempt)
        answer = {VerdictStatus.OK: "granted", VerdictStatus.STALE: "refused"}.get(verdict)
        for after in (world,) if granted is None else _changed(protocol, bounds, world, granted):
            yield after
            if answer:
                yield _send(after, (answer, recorder, index, attempt))
    elif kind == "done":
        written = Written(recorder=recorder, attempt=attempt, shard="s", samples=5)
        yield from _changed(protocol, bounds, world, protocol.commit(episode, written))
    elif kind == "lost":
        yield from _changed(protocol, bounds, world, protocol.take_back(episode, recorder, attempt))


def _forged_reports(protocol: Protocol, world: World, bounds: Bounds) -> Iterator[World]:
    """A recorder reports as durable what it was never granted."""
    for recorder, episode, attempt in itertools.product(RECORDERS, world.episodes, range(1, bounds.attempts + 1)):
        if (episode.state, episode.recorder, episode.attempt) != (StageState.GRANTED, recorder, attempt):
            written = Written(recorder=recorder, attempt=attempt, shard="s", samples=5)
            yield from _changed(protocol, bounds, world, protocol.commit(episode, written))


def _stuck(worlds: list[World], parents: list[list[int]], bounds: Bounds) -> int:
    """States from which no finished state, and none at the bound of attempts, can be reached."""
    good = [
        number
        for number, world in enumerate(worlds)
        if _is_finished(world, bounds) or any(episode.attempt >= bounds.attempts for episode in world.episodes)
    ]
    reached = set(good)
    while good:
        for parent in parents[good.pop()]:
            if parent not in reached:
                reached.add(parent)
                good.append(parent)
    return len(worlds) - len(reached)
