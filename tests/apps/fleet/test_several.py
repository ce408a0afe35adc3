"""Two runs of one fleet at a router that outlives them: toy stages, real bus, ledgers and shards."""

import dataclasses
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, nullcontext, suppress
from pathlib import Path

import pytest

from readygo.apps.fleet import runs, several
from readygo.apps.fleet.access import join
from readygo.apps.fleet.lead import lead
from readygo.apps.fleet.runs import ANY_RUN, Runs
from readygo.apps.fleet.several import record_for, work_for
from readygo.apps.fleet.token import TOKEN_VARIABLE
from readygo.apps.fleet.worker import make_recorder
from readygo.common.bus import zenoh_bus
from readygo.common.bus.zenoh_bus import Router, free_endpoint
from readygo.common.dataset import Dataset
from readygo.common.errors import BusError, RunError
from readygo.common.fleet import Inputs, StageResult, Worker, pull
from readygo.common.messages import ClaimReply, Command, ControlRequest, RunSpecRequest, topics
from readygo.runs.config import with_run_keys
from readygo.runs.folder import RunFolder
from readygo.runs.stages import stage_works
from readygo.runs.world import World
from readygo.services.coordinator import service
from readygo.services.recorder import attach as attach_recorder
from tests.apps.fleet.toy_line import DRAW, FILM, draw, entry, in_process, make_folder
from tests.waiting import wait_for

LINE = [DRAW, FILM]


class Fleet:
    """A router, a recorder and a worker, who serve whatever run comes."""

    def __init__(self, endpoint: str, shards: Path) -> None:
        self.endpoint, self.shards = endpoint, shards
        self.drawn: list[str] = []
        """Runs whose episodes were drawn, in order."""
        self.slow_s: dict[str, float] = {}
        """How long drawing takes in a run."""
        self.stop = threading.Event()

    def record(self, runs: Runs) -> None:
        record_for(runs, self._record, self.stop)

    def work(self, runs: Runs) -> None:
        work_for(runs, self._work, self.stop)

    def _record(self, run: str, leave: Callable[[], bool]) -> bool:
        bus = join(self.endpoint, run, "recorder", name="rec0")
        over = threading.Event()
        bus.subscribe(topics.PROGRESS, lambda status: over.set() if status.finished or status.failed else None)
        world = World(bus.request(topics.SPEC, RunSpecRequest(), timeout_s=20.0), bus)
        recorder = make_recorder(bus, "rec0", RunFolder(self.shards / run), world)
        attach_recorder(bus, recorder)
        bus.announce("recorder", "rec0")
        while not (over.wait(0.1) or leave()):
            recorder.settle()
        recorder.close()
        bus.close()
        return over.is_set()

    def _work(self, run: str, leave: Callable[[], bool]) -> bool:
        bus = join(self.endpoint, run, "all")
        world = World(bus.request(topics.SPEC, RunSpecRequest(), timeout_s=20.0), bus)

        def noted_draw(claim: ClaimReply, inputs: Inputs) -> StageResult:
            self.drawn.append(run)
            threading.Event().wait(self.slow_s.get(run, 0.0))
            return draw(claim, inputs)

        works = stage_works(world, bus, line=(entry(DRAW.stage, noted_draw), FILM))
        bus.announce("all", "w")
        over = pull(bus, Worker(name="w", numeric_class="this", works=works), leave=leave)
        bus.close()
        return over


@pytest.fixture
def router(monkeypatch: pytest.MonkeyPatch) -> Iterator[Router]:
    monkeypatch.setenv(TOKEN_VARIABLE, "secret")
    monkeypatch.setattr(zenoh_bus, "_GONE_S", 0.5)
    monkeypatch.setattr(runs, "STEADY_S", 0.2)
    monkeypatch.setattr(service, "TELL_S", 0.1)
    router = Router(free_endpoint(), "secret")
    yield router
    router.close()


@pytest.fixture
def begun(router: Router, tmp_path: Path) -> Iterator[tuple[Fleet, Callable[..., Future]]]:  # type: ignore[type-arg]
    """A fleet, and what starts one of its parts; whatever happens, all of it ends."""
    fleet = Fleet(router.endpoint, tmp_path / "shards")
    with ThreadPoolExecutor(8) as pool, ExitStack() as ended:
        ended.callback(fleet.stop.set)
        led: list[tuple[str, Future]] = []  # type: ignore[type-arg]
        ended.callback(_cancel, router.endpoint, led)

        def serve(part: Callable[[Runs], None], **options: object) -> Future:  # type: ignore[type-arg]
            bus = join(router.endpoint, ANY_RUN, "all")
            ended.callback(bus.close)
            return pool.submit(part, Runs(bus, **options))  # type: ignore[arg-type]

        def start(part: Callable[[Runs], None] | RunFolder, **options: object) -> Future:  # type: ignore[type-arg]
            if not isinstance(part, RunFolder):
                return serve(part, **options)
            future = pool.submit(lead, part, router.endpoint, joins=True)
            led.append((part.load()[0].run, future))
            return future

        yield fleet, start


def _cancel(endpoint: str, led: list[tuple[str, Future]]) -> None:  # type: ignore[type-arg]
    """End what a test that failed has left."""
    for run, future in led:
        with suppress(BusError):
            while not future.done():
                bus = join(endpoint, run, "operator")
                bus.request(topics.CONTROL, ControlRequest(command=Command.CANCEL))
                bus.close()
                wait([future], timeout=1.0)


def _run(path: Path, name: str, *, wanted: int, priority: int = 0) -> RunFolder:
    folder = make_folder(path / name, LINE, wanted=wanted)
    spec, _ = folder.load()
    folder.save(with_run_keys(dataclasses.replace(spec, run=name), {"coordinator": {"priority": priority}}), wanted)
    return folder


def test_urgent_run_comes_first_and_both_have_the_samples_that_they_have_alone(begun, tmp_path: Path) -> None:
    fleet, start = begun
    fleet.slow_s["low"] = 0.2
    start(fleet.record)
    start(fleet.work)
    low = start(_run(tmp_path, "low", wanted=12))
    wait_for(lambda: "low" in fleet.drawn)
    high = start(_run(tmp_path, "high", wanted=4, priority=5))
    for led, wanted in ((high, 4), (low, 12)):
        status = led.result(timeout=60)
        assert (status.finished, status.committed) == (True, wanted)
    first, last = fleet.drawn.index("high"), len(fleet.drawn) - fleet.drawn[::-1].index("high")
    # Begun in the middle of the other one, which goes on when it is over.
    assert set(fleet.drawn[first:last]) == {"high"}
    assert fleet.drawn[0] == fleet.drawn[-1] == "low"
    for name, wanted in (("low", 12), ("high", 4)):
        alone = make_folder(tmp_path / f"{name}-alone", LINE, wanted=wanted)
        in_process(alone, LINE)
        assert Dataset([fleet.shards / name]).content_hash == Dataset([alone.path]).content_hash


def test_run_that_is_led_already_is_refused_and_goes_on(begun, tmp_path: Path) -> None:
    fleet, start = begun
    led = start(_run(tmp_path / "one", "same", wanted=2))
    wait_for((tmp_path / "one" / "same" / ".readygo" / "endpoint").exists)
    with pytest.raises(BusError, match=r"Run same is led already by another .*: stop that .* another --seed\."):
        lead(_run(tmp_path / "two", "same", wanted=2), fleet.endpoint, joins=True)
    start(fleet.record, named=("same",))
    worker = start(fleet.work, named=("same",))
    assert led.result(timeout=60).finished
    worker.result(timeout=60)


def test_run_that_somebody_cannot_take_part_in_holds_up_no_other(begun, tmp_path: Path, caplog) -> None:
    fleet, start = begun
    work = fleet._work

    def refused(run: str, leave: Callable[[], bool]) -> bool:
        if run == "other-version":
            raise RunError("The run is of readygo 9.9.")
        return work(run, leave)

    fleet._work = refused
    start(_run(tmp_path, "other-version", wanted=2, priority=9))
    led = start(_run(tmp_path, "mine", wanted=2))
    start(fleet.record)
    start(fleet.work)
    assert led.result(timeout=60).finished
    assert caplog.text.count("other-version is left alone: The run is of readygo 9.9.") == 1


def test_named_runs_that_nobody_leads_are_not_waited_for_for_ever(begun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(several, "SILENT_S", 0.3)
    fleet, start = begun
    for part in (fleet.work, fleet.record):
        with pytest.raises(BusError, match=r"No coordinator leads a run of x, y there\."):
            start(part, named=("y", "x")).result(timeout=60)


class FakeRuns:
    """Runs that are over after so many looks at them."""

    def __init__(self, *choices: str, named: tuple[str, ...] = ("a", "b"), heard_s: float = 0.0) -> None:
        self.choices, self.named, self.heard_s = list(choices), set(named), heard_s
        self.told: list[tuple[object, ...]] = []

    @property
    def over(self) -> bool:
        return not self.choices

    def choose(self) -> str:
        return self.choices.pop(0)

    def open(self) -> list[str]:
        return [run for run in self.choices.pop(0).split() if run]

    def bar(self, run: str) -> None:
        self.told.append(("bar", run))

    def left(self, run: str, *, over: bool) -> None:
        self.told.append(("left", run, over))

    def better_than(self, run: str) -> bool:
        return run == "b"


class FakeStop:
    """Is never set from outside, and counts its waits."""

    def __init__(self) -> None:
        self.waits: list[float] = []
        self.ended = False

    def is_set(self) -> bool:
        return self.ended

    def set(self) -> None:
        self.ended = True

    def wait(self, seconds: float) -> None:
        self.waits.append(seconds)


def _part(run: str, leave: Callable[[], bool]) -> bool:
    if run == "c":
        raise RunError("of another version")
    return not leave()


def test_worker_does_one_run_after_the_other_and_leaves_alone_what_it_cannot_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(several.time, "monotonic", lambda: 30.0)
    runs, stop = FakeRuns("a", "", "c", "b", ""), FakeStop()
    several.work_for(runs, _part, stop)  # type: ignore[arg-type]
    assert runs.told == [("left", "a", True), ("bar", "c"), ("left", "b", False)]
    assert stop.waits == [0.2, 0.2]


def test_recorder_takes_part_in_all_open_runs_at_once_and_again_where_it_was_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(several.time, "monotonic", lambda: 30.0)
    begun: list[str] = []
    both = threading.Barrier(2)

    def part(run: str, leave: Callable[[], bool]) -> bool:
        begun.append(run)
        if run in "ab":
            both.wait(10.0)
        return leave()

    runs, stop = FakeRuns("a b", "d", ""), FakeStop()
    several.record_for(runs, part, stop)  # type: ignore[arg-type]
    assert sorted(begun) == ["a", "b", "d"]
    assert sorted(told[1] for told in runs.told) == ["a", "b", "d"]
    assert (stop.waits, stop.ended) == ([0.2] * 3, True)


@pytest.mark.parametrize(("now_s", "named", "given_up"), [(40.0, ("x", "y"), False), (40.1, ("x", "y"), True),
                                                          (99.0, (), False)])  # fmt: skip
def test_named_runs_are_waited_for_half_a_minute(
    monkeypatch: pytest.MonkeyPatch, now_s: float, named: tuple[str, ...], given_up: bool
) -> None:
    monkeypatch.setattr(several.time, "monotonic", lambda: now_s)
    for serve in (several.work_for, several.record_for):
        with pytest.raises(BusError, match=r"No coordinator leads a run of x, y there") if given_up else nullcontext():
            serve(FakeRuns("", named=named, heard_s=10.0), _part, FakeStop())  # type: ignore[arg-type]
