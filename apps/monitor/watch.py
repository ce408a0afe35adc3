"""State of a run from its live streams, in bounded memory; sends no requests to the run."""

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

from readygo.apps.monitor.history import History
from readygo.apps.monitor.track import EpisodeTrack, Pictures, pictures_of, replans_of
from readygo.common.bus import Bus, Member
from readygo.common.messages import DriverKind, EpisodeKey, Outcome, RunSpec, StatusReply, topics
from readygo.common.messages.live import (
    LiveCommit,
    LiveEvaluation,
    LiveLoss,
    LivePerception,
    LivePlan,
    LivePreview,
    LiveState,
    LiveWork,
)

EPISODES_MAX = 12
"""Largest number of episodes with states and images; the one with the oldest last message is dropped."""
STATES_MAX, PREVIEWS_MAX = 600, 100
"""Largest numbers of states and images per episode; each camera's images count."""
WORKERS_MAX = 256
"""Largest number of workers; those that have left are dropped first."""
COMMITS_MAX = 500
RECENT = 100
"""Number of latest episodes for a success rate."""
FRESH_S = 4.0
"""Time without a message after which an episode no longer counts as running [s]."""
RATE_WINDOW_S = 30.0
"""Window of the rate of samples, which arrive by whole episodes [s]."""

Message = TypeVar("Message")
Clock = Callable[[], float]


@dataclass
class Seen:
    """Last known state of a worker."""

    role: str
    name: str
    alive: bool = True
    sessions: set[str] = field(default_factory=set)
    """Present sessions under its name: more than one while a worker that was cut off meets its successor."""
    stage: str = ""
    """Stage that it works on; empty while it waits."""
    episode: EpisodeKey | None = None
    since_s: float = 0.0
    done: int = 0
    """Number of finished stages of episodes."""
    rejected: int = 0
    cpu_s: float = 0.0
    memory_bytes: int = 0
    trouble: str = ""
    """Its latest error; empty without one."""
    preview: LivePreview | None = None


@dataclass
class Moving:
    """Received part of a running episode."""

    episode: EpisodeKey
    worker: str = ""
    plan: LivePlan | None = None
    states: deque[tuple[float, LiveState]] = field(default_factory=lambda: deque(maxlen=STATES_MAX))
    """States, with the times of their arrival [s]."""
    previews: deque[tuple[int, Pictures]] = field(default_factory=deque)
    """Simulated times [ns], with the images of that time."""
    image_format: str = "jpeg"
    perception: LivePerception | None = None
    """The newest perception of its driver; None for drivers that do not perceive."""
    heard_s: float = 0.0
    commit: LiveCommit | None = None

    def track(self) -> EpisodeTrack | None:
        """The episode for display; None before its first state."""
        if not self.states:
            return None
        height_m = self.states[0][1].robot_xyzyaw[2]
        return EpisodeTrack(
            episode=self.episode,
            states=[state for _, state in self.states],
            images=list(self.previews),
            image_format=self.image_format,
            outcome=self.commit.outcome if self.commit else None,
            policy=self.commit.policy if self.commit else "",
            **({"replans": replans_of(self.plan, height_m)} if self.plan else {}),
        )


class RunWatch:
    """State of one run. Its handlers run on a bus's thread; readers must hold `lock`."""

    def __init__(self, clock: Clock = time.monotonic) -> None:
        self.lock = threading.RLock()
        self.clock = clock
        self.begun_s = clock()
        self.spec: RunSpec | None = None
        self.status: StatusReply | None = None
        self.heard_s = float("-inf")
        """Time of the coordinator's last message [s]."""
        self.connection = ""
        """Error of the connection; empty without one."""
        self.workers: OrderedDict[tuple[str, str], Seen] = OrderedDict()
        self.moving: OrderedDict[EpisodeKey, Moving] = OrderedDict()
        self.commits: deque[LiveCommit] = deque(maxlen=COMMITS_MAX)
        self.progress = History(apart=1.0)
        """Over seconds: samples, episodes, waiting, in progress, rejected, requeued."""
        self.losses = History()
        """Over training samples: training and validation loss."""
        self.driven = History()
        """Over minutes: success rate of the latest policy-driven episodes."""
        self.evaluations: deque[LiveEvaluation] = deque(maxlen=10 * COMMITS_MAX)
        self._recent: deque[bool] = deque(maxlen=RECENT)
        self._heard: set[tuple[str, str]] = set()
        self._bus: Bus | None = None

    def join(self, bus: Bus) -> None:
        """Subscribe to all streams of a run."""
        with self.lock:
            self._bus = bus
            self._heard.clear()
            for seen in self.workers.values():
                seen.alive = False
                seen.sessions.clear()
        bus.subscribe(topics.PROGRESS, self._on_progress)
        bus.watch(partial(self._on_presence, bus))

    def leave(self) -> None:
        """Subscribe to no further workers on the bus, which is about to be closed."""
        with self.lock:
            self._bus = None

    def under_way(self) -> list[Moving]:
        """The running episodes, with a message within `FRESH_S`, by worker."""
        now_s = self.clock()
        fresh = [
            moving
            for moving in self.moving.values()
            if moving.states and moving.commit is None and now_s - moving.heard_s < FRESH_S
        ]
        newest = {moving.worker: moving for moving in sorted(fresh, key=lambda moving: moving.heard_s)}
        return [newest[worker] for worker in sorted(newest)]

    @property
    def samples_hz(self) -> float:
        """Durable samples per second [Hz]; nan if unknown."""
        return self.progress.rate(0, RATE_WINDOW_S)

    def _on_progress(self, status: StatusReply) -> None:
        with self.lock:
            if self.status and status.samples < self.status.samples:
                self.progress.clear()
            self.status, self.heard_s = status, self.clock()
            waiting, leased = sum(status.waiting.values()), sum(status.leased.values())
            rejected = sum(status.rejected.values())
            row = (status.samples, status.committed, waiting, leased, rejected, status.requeued)
            self.progress.add(self.heard_s - self.begun_s, row)

    def _on_presence(self, bus: Bus, member: Member, alive: bool) -> None:
        role, name = member.role, member.name
        with self.lock:
            if (role, name) not in self.workers:
                self._make_room()
                self.workers[role, name] = Seen(role=role, name=name, since_s=self.clock())
            seen = self.workers[role, name]
            (seen.sessions.add if alive else seen.sessions.discard)(member.session)
            seen.alive = bool(seen.sessions)
            if not seen.alive:
                seen.stage, seen.episode = "", None
            new = self._bus is bus and alive and (role, name) not in self._heard and len(self._heard) < WORKERS_MAX
            if new:
                self._heard.add((role, name))
        if new:
            self._hear(bus, role, name)

    def _make_room(self) -> None:
        while len(self.workers) >= WORKERS_MAX:
            gone = next((key for key, seen in self.workers.items() if not seen.alive), next(iter(self.workers)))
            del self.workers[gone]

    def _hear(self, bus: Bus, role: str, name: str) -> None:
        """Subscribe to a worker; each worker has separate streams, which identify the sender of a message."""

        def hear(live: topics.Live[Message], handler: Callable[[tuple[str, str], Message], None]) -> None:
            bus.subscribe(live.of(role, name), partial(handler, (role, name)))

        hear(topics.WORK, self._on_work)
        hear(topics.STATE, self._on_state)
        hear(topics.PREVIEW, self._on_preview)
        hear(topics.PERCEPTION, self._on_perception)
        hear(topics.PLAN, self._on_plan)
        hear(topics.COMMIT, self._on_commit)
        hear(topics.LOSS, self._on_loss)
        hear(topics.EVALUATION, self._on_evaluation)

    def _episode(self, episode: EpisodeKey) -> Moving:
        moving = self.moving.get(episode)
        if moving is None:
            moving = self.moving[episode] = Moving(episode=episode)
            while len(self.moving) > EPISODES_MAX:
                self.moving.popitem(last=False)
        self.moving.move_to_end(episode)
        return moving

    def _on_work(self, worker: tuple[str, str], work: LiveWork) -> None:
        with self.lock:
            if (seen := self.workers.get(worker)) is None:
                return
            seen.stage, seen.episode = (work.stage, work.episode) if work.begins else ("", None)
            seen.since_s, seen.cpu_s, seen.memory_bytes = self.clock(), work.cpu_s, work.memory_bytes
            seen.done += not work.begins
            seen.rejected += bool(work.rejected)
            seen.trouble = work.failed or seen.trouble

    def _on_state(self, worker: tuple[str, str], state: LiveState) -> None:
        with self.lock:
            moving = self._episode(state.episode)
            if moving.states and state.time_ns <= moving.states[-1][1].time_ns:
                # A new attempt begins from the start.
                moving.states.clear()
                moving.previews.clear()
                moving.commit = moving.perception = None
            moving.worker, moving.heard_s = worker[1], self.clock()
            moving.states.append((moving.heard_s, state))

    def _on_preview(self, worker: tuple[str, str], preview: LivePreview) -> None:
        with self.lock:
            moving = self._episode(preview.episode)
            pictures = pictures_of(preview)
            moving.previews.append((preview.time_ns, pictures))
            while len(moving.previews) > max(1, PREVIEWS_MAX // len(pictures)):
                moving.previews.popleft()
            moving.image_format = preview.format
            if worker in self.workers:
                self.workers[worker].preview = preview

    def _on_perception(self, _: tuple[str, str], perception: LivePerception) -> None:
        with self.lock:
            self._episode(perception.episode).perception = perception

    def _on_plan(self, _: tuple[str, str], plan: LivePlan) -> None:
        with self.lock:
            self._episode(plan.episode).plan = plan

    def _on_commit(self, _: tuple[str, str], commit: LiveCommit) -> None:
        with self.lock:
            self.commits.append(commit)
            if commit.episode in self.moving:
                self.moving[commit.episode].commit = commit
            if commit.driver is DriverKind.POLICY:
                self._recent.append(commit.outcome is Outcome.SUCCESS)
                minutes = (self.clock() - self.begun_s) / 60
                self.driven.add(minutes, (sum(self._recent) / len(self._recent),))

    def _on_loss(self, _: tuple[str, str], loss: LiveLoss) -> None:
        with self.lock:
            self.losses.add(loss.samples, (loss.train_loss, loss.validation_loss))

    def _on_evaluation(self, _: tuple[str, str], evaluation: LiveEvaluation) -> None:
        with self.lock:
            self.evaluations.append(evaluation)
