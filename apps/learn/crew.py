"""All processes of a learning run: a fleet in every scene and one trainer."""

import contextlib
import time
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType

from readygo.apps.fleet.access import join, open_router, reached_here, refusals_on_stderr
from readygo.apps.fleet.fleet import Fleet
from readygo.apps.fleet.fork_server import ForkServer
from readygo.apps.fleet.roles import places as places_of
from readygo.apps.fleet.token import given_token, new_token, with_token
from readygo.apps.learn.cores import CoreSplit, shared_out
from readygo.apps.learn.plan import LearnPlace, LearnPlan
from readygo.apps.learn.training import Training, write_trainer_config
from readygo.common.bus import Member
from readygo.common.bus.identity import ALL, COORDINATOR, TRAINER
from readygo.common.bus.zenoh_bus import ZenohBus, free_endpoint
from readygo.common.errors import BusError, RunError
from readygo.common.messages import Command, ControlRequest, StatusReply, topics
from readygo.common.messages.stages import STAGES
from readygo.runs.recovery import recover
from readygo.services.evaluator import EpisodeRecord, shown_record

EVALUATOR = "evaluator"
"""Role and name of the supervisor, which measures policies, in its runs."""
FROZEN_S = 120.0
"""Time without a sign of progress after which the trainer is restarted [s]."""
CONTROL_S = 2.0
"""Longest wait for a coordinator to take a command [s]."""
PACE_S = 5.0
"""Period of repeating to a coordinator whether to collect [s]."""
FAREWELL_S = 30.0
"""Time for workers on other machines to finish their episodes and leave at the end of the run [s]."""
STOP_S = 2.0
"""Time for workers on other machines to leave when the run is interrupted [s]."""
LOOK_S = 0.1
"""Period of checking whether they have left [s]."""
COLLECTORS = frozenset({ALL, *(stage.role for stage in STAGES)})
"""Roles of the workers that make episodes."""
DEAF_MAX = 6
"""Number of consecutive unanswered commands after which a coordinator is restarted."""


@dataclass(frozen=True, kw_only=True)
class Reach:
    """Access of workers on other machines to a learning run."""

    listen: str = ""
    """Endpoint of the router; empty takes a free loopback port."""
    certs: Path | None = None
    """Folder of certificates, for an endpoint tls/..."""
    hosts: bool = False
    """True if all collectors are on other machines: the trainer gets all cores of this one."""


ALONE = Reach()


class Crew:
    """Supervisor of the processes: starts, restarts and ends them; a context that leaves no process behind."""

    def __init__(self, plan: LearnPlan, split: CoreSplit, reach: Reach = ALONE) -> None:
        self.status: dict[str, StatusReply] = {}
        """Last status of each scene's run."""
        self._plan, self._split = plan, split
        self._reach, self._endpoint = reach, reach.listen or free_endpoint()
        self._token = "" if reach.certs else given_token() or new_token()
        self._fleets: dict[str, Fleet] = {}
        self._buses: dict[str, ZenohBus] = {}
        self._collectors: set[tuple[str, Member]] = set()
        """Present collectors, with their scenes."""
        self._collects, self._paced_s = True, 0.0
        self._deaf: Counter[str] = Counter()
        """Number of consecutive unanswered commands of each scene's coordinator."""
        self._open = contextlib.ExitStack()
        self._logs = plan.out / "logs"
        self._forks = ForkServer(with_token(self._token), self._logs / "fork-server.log")

    def __enter__(self) -> "Crew":
        try:
            self._start()
        except BaseException:
            self._open.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self._dismiss(FAREWELL_S if error is None else STOP_S)
        self._open.close()
        if error is None:
            for fleet in self._fleets.values():
                fleet.check_recorders()

    @property
    def samples(self) -> int:
        """Number of samples in the shards of all scenes."""
        return sum(status.samples for status in self.status.values())

    @property
    def images(self) -> int:
        """Number of samples with an image in the shards of all scenes."""
        return self._plan.image_count(self.samples)

    @property
    def policies(self) -> int:
        """Number of policies that the trainer has offered."""
        return max((status.policies for status in self.status.values()), default=0)

    @property
    def collect_hz(self) -> float:
        """Images that one core records per second, by the stages' processor time [Hz]; 0 while unknown."""
        cpu_s = sum(sum(status.cpu_s.values()) for status in self.status.values())
        return self.images / cpu_s if cpu_s > 0 else 0.0

    @property
    def running(self) -> CoreSplit:
        """The current division of the cores."""
        return self._split

    def check(self, training: Training) -> None:
        """Restart processes that ended, and a trainer that hangs.

        Raises:
            RunError: If a process ends repeatedly, or a run has failed.
        """
        for name, fleet in self._fleets.items():
            status = self.status.get(name)
            if status and status.failed:
                raise RunError(f"Scene {name}: {status.failed}")
            if not (status and status.finished):
                fleet.check()
        if training.ended:
            return
        if time.time() - max(training.told_s, self._trainer_begun_s) > FROZEN_S:
            self._start_trainer()
        self._trainer.check()

    def show(self, name: str, policy: str, record: EpisodeRecord) -> None:
        """Publish an episode of a measurement to a scene's run, for monitors."""
        self._buses[name].tell(topics.EVALUATION, lambda: shown_record(record, policy))

    def pace(self, wanted: bool) -> None:
        """Let the collectors work, or pause them.

        The command is repeated periodically: a coordinator that was just starting has missed it, and a missing answer
        reveals a coordinator that cannot be reached.
        """
        if wanted == self._collects and time.monotonic() - self._paced_s < PACE_S:
            return
        self._collects, self._paced_s = wanted, time.monotonic()
        for name in self._buses:
            self._command(name, Command.RESUME if wanted else Command.PAUSE)

    def _command(self, name: str, command: Command) -> None:
        """Send a command to a scene's coordinator; one that does not answer repeatedly is restarted."""
        try:
            self._buses[name].request(topics.CONTROL, ControlRequest(command=command), timeout_s=CONTROL_S)
        except BusError:
            self._deaf[name] += 1
        else:
            del self._deaf[name]
        if self._deaf[name] >= DEAF_MAX:
            del self._deaf[name]
            self._fleets[name].kill(COORDINATOR)

    def split(self, split: CoreSplit) -> None:
        """Change the division of the cores: add or remove collectors, restart the trainer with other threads."""
        threads = self._split.trainer_threads
        self._split = split
        counts = shared_out(split.collectors, len(self._plan.places))
        for place, wanted in zip(self._plan.places, counts, strict=True):
            self._collect(self._fleets[place.name], wanted)
        if split.trainer_threads != threads:
            self._start_trainer()

    def _start(self) -> None:
        if self._reach.certs:
            self._open.enter_context(refusals_on_stderr())
        recorders = self._plan.config.coordinator.recorders
        router = open_router(recorders, self._endpoint, certs=self._reach.certs, token=self._token)
        self._open.callback(router.close)
        self._logs.mkdir(exist_ok=True)
        self._open.callback(self._forks.close)
        places = self._plan.places
        for place, count in zip(places, shared_out(self._split.collectors, len(places)), strict=True):
            self._start_fleet(place, count)
        data = [place.folder.path.resolve() for place in places]
        self._trainer = self._fleet(",".join(place.spec.run for place in places), data, self._logs)
        self._open.callback(self._trainer.stop)
        self._start_trainer()

    def _start_fleet(self, place: LearnPlace, collectors: int) -> None:
        folder, spec = place.folder, place.spec
        self._open.enter_context(folder.lock())
        recover(folder)
        here = reached_here(self._endpoint)
        bus = join(here, spec.run, COORDINATOR, certs=self._reach.certs, token=self._token)
        self._open.callback(bus.close)
        self._buses[place.name] = bus
        bus.announce(EVALUATOR, EVALUATOR)
        bus.subscribe(topics.PROGRESS, partial(self.status.__setitem__, place.name))
        bus.watch(partial(self._note_presence, place.name))
        fleet = self._fleet(spec.run, [folder.path.resolve()], folder.logs)
        self._fleets[place.name] = fleet
        self._open.callback(fleet.stop)
        self._open.enter_context(folder.reachable(here, self._token))
        for role, name in places_of(spec, self._plan.config.coordinator.recorders, collectors, together=True):
            fleet.add(role, name)

    def _fleet(self, run: str, data: list[Path], logs: Path) -> Fleet:
        here, certs = reached_here(self._endpoint), self._reach.certs
        return Fleet(connect=here, run=run, data=data, logs=logs, certs=certs, forks=self._forks)

    def _dismiss(self, patience_s: float) -> None:
        """Cancel the runs for workers on other machines, and wait until they leave."""
        if not self._reach.listen:
            return
        for name in self._buses:
            with contextlib.suppress(BusError):
                self._buses[name].request(topics.CONTROL, ControlRequest(command=Command.CANCEL), timeout_s=CONTROL_S)
        deadline_s = time.monotonic() + patience_s
        while self._guests() and time.monotonic() < deadline_s:
            time.sleep(LOOK_S)

    def _guests(self) -> set[tuple[str, str]]:
        """Scene and name of the present collectors on other machines."""
        own = {(place, member.name) for place, fleet in self._fleets.items() for member in fleet.members}
        return {(place, member.name) for place, member in self._collectors} - own

    def _note_presence(self, place: str, member: Member, alive: bool) -> None:
        if member.role in COLLECTORS:
            (self._collectors.add if alive else self._collectors.discard)((place, member))

    def _collect(self, fleet: Fleet, wanted: int) -> None:
        names = [member.name for member in fleet.members if member.role == ALL]
        for name in names[wanted:]:
            fleet.remove(name)
        for number in range(len(names), wanted):
            fleet.add(ALL, f"{ALL}{number}")

    def _start_trainer(self) -> None:
        """Start the trainer, which resumes from its checkpoint; a running one is ended first."""
        for member in list(self._trainer.members):
            self._trainer.remove(member.name)
        config = write_trainer_config(self._plan, self._split.trainer_threads)
        out: Path = self._plan.policy.resolve()
        self._trainer.add(TRAINER, TRAINER, "--out", str(out), "--config", str(config.resolve()))
        self._trainer_begun_s = time.time()
