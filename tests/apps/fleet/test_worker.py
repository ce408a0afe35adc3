import threading
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from readygo.apps.fleet import access
from readygo.apps.fleet.process import LATE_S
from readygo.apps.fleet.runs import ANY_RUN
from readygo.apps.fleet.worker import WorkerOptions, _coordinate, _Part, _record, _serve_runs, _take_part, _work, worker
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.errors import CANNOT_WORK, BusError, RunError
from readygo.common.fleet import Worker
from readygo.common.messages import topics
from tests.common.messages.run_specs import SPEC


@pytest.fixture
def endpoint() -> Iterator[str]:
    router = Router(free_endpoint())
    bus = ZenohBus(router.endpoint, "run-test")
    bus.serve(topics.SPEC, lambda _: SPEC)
    yield router.endpoint
    bus.close()
    router.close()


@pytest.fixture(autouse=True)
def _signals_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.apps.fleet.process.signal.signal", lambda *_: None)
    # Kernels are not what these tests are about, and nor is who made the run.
    monkeypatch.setattr("readygo.runs.warm.warm_once", lambda *_: None)
    monkeypatch.setattr("readygo.apps.fleet.worker.check_same_make", lambda *_: None)


def test_worker_that_somebody_must_help_ends_with_a_code_of_its_own(
    endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for role, options, words in (
        ("recorder", {}, "A recorder needs the run's data folder: pass --data."),
        ("coordinator", {"data": (tmp_path,)}, f"{tmp_path} holds no recorded run"),
        ("juggler", {}, "The run has nothing to do for a 'juggler'; its stages need: human-planner, animator, robot-"),
    ):
        with pytest.raises(SystemExit) as exit_info:
            worker(WorkerOptions(role=role, connect=endpoint, run="run-test", **options))
        assert exit_info.value.code == CANNOT_WORK == 78
        assert capsys.readouterr().err.splitlines()[-1].startswith(f"readygo: {words}")


def test_worker_without_a_bus_may_try_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access, "ROUTER_ABSENT_S", 0.0)
    with pytest.raises(BusError, match="No router answers"):
        worker(WorkerOptions(role="animator", connect=free_endpoint(), run="run-test"))


class Fakes:
    """Stands in for what a worker process calls, and keeps what it was asked."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        self.calls: list[tuple[object, ...]] = []
        self.stop = threading.Event()
        self.bus, self.folder = Mock(name="bus"), Mock(path=tmp_path)
        self.folder.lock_coordinator.return_value = nullcontext()
        self.observer = Mock()
        self.observer.bus.side_effect = lambda bus: bus
        self._monkeypatch = monkeypatch
        self.put("showing_health", lambda *args, **named: self.calls.append(("health", args, named)) or nullcontext())

    def put(self, name: str, what: object) -> None:
        self._monkeypatch.setattr(f"readygo.apps.fleet.worker.{name}", what)

    def part(self, role: str, *data: Path) -> object:
        return _Part(
            role, "w7", data, self.observer, lambda run: self.calls.append(("join", run)) or self.bus, self.stop
        )


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Fakes:
    return Fakes(monkeypatch, tmp_path)


def test_coordinator_takes_the_lead_attaches_and_ticks_until_it_is_stopped(fakes: Fakes) -> None:
    order: list[str] = []
    coordinator = Mock(over=True)
    fakes.put("make_coordinator", lambda folder: coordinator)
    fakes.put("take_the_lead", lambda bus, who: order.append("lead") or (lambda: order.append("on")))
    fakes.put("coordination", Mock(attach=lambda *_: order.append("attach"), tick=lambda *_: order.append("tick")))
    waits = iter([False, False, True])
    stop = Mock(wait=lambda seconds: order.append(f"{seconds}") or next(waits))
    assert _coordinate(fakes.bus, fakes.folder, stop, fakes.observer)
    assert order == ["lead", "attach", "0.2", "on", "tick", "0.2", "on", "tick", "0.2"]
    fakes.folder.lock_coordinator.assert_called_once_with(patience_s=2 * LATE_S)
    fakes.observer.coordinator.assert_called_once_with(coordinator)


@pytest.mark.parametrize(("alone", "said", "over"), [(True, "finished", True), (True, "failed", True),
                                                     (True, "", False), (False, "finished", False)])  # fmt: skip
def test_recorder_settles_until_its_run_is_over_and_closes_its_shards(
    fakes: Fakes, alone: bool, said: str, over: bool
) -> None:
    recorder = Mock()
    fakes.bus.announce.side_effect = lambda *who: fakes.calls.append(("there",))
    world = SimpleNamespace(spec=SPEC)
    fakes.put("_world", lambda bus, role: world)
    fakes.put("make_recorder", lambda *args: fakes.calls.append(args) or recorder)
    fakes.put("attach_recorder", lambda *args: fakes.calls.append(args))
    status = SimpleNamespace(finished=said == "finished", failed="broken" if said == "failed" else "")

    def settle() -> None:
        if recorder.settle.call_count == 2:
            for call in fakes.bus.subscribe.call_args_list:
                assert call.args[0] is topics.PROGRESS
                call.args[1](status)
        if recorder.settle.call_count == 3:
            fakes.stop.set()

    recorder.settle.side_effect = settle
    fakes.put("SETTLE_S", 0.0)
    assert _record(fakes.bus, "rec0", fakes.folder, fakes.stop, fakes.observer, alone=alone) is over
    assert recorder.settle.call_count == (2 if over else 3)
    recorder.close.assert_called_once_with()
    assert fakes.calls == [(fakes.bus, "rec0", fakes.folder, world), ("there",), (fakes.bus, recorder)]
    fakes.bus.announce.assert_called_once_with("recorder", "rec0")
    fakes.observer.recorder.assert_called_once_with(recorder, SPEC.run)


@pytest.mark.parametrize("of", ["announce", "attach", "settle", "close"])
def test_recorder_leaves_its_name_and_its_metrics_after_an_error(fakes: Fakes, of: str) -> None:
    recorder, said = Mock(), RunError("It cannot be.")
    failing = {"announce": fakes.bus.announce, "settle": recorder.settle, "close": recorder.close}.get(of, Mock())
    failing.side_effect = said
    fakes.put("_world", lambda bus, role: SimpleNamespace(spec=SPEC))
    fakes.put("make_recorder", lambda *args: recorder)
    fakes.put("attach_recorder", failing if of == "attach" else lambda *args: None)
    fakes.put("SETTLE_S", 0.0)
    if of == "close":
        fakes.stop.set()
    with pytest.raises(RunError, match=r"It cannot be\."):
        _record(fakes.bus, "rec0", fakes.folder, fakes.stop, fakes.observer, alone=True)
    recorder.leave.assert_called_once_with()
    fakes.observer.recorder.return_value.assert_called_once_with()
    if of == "announce":
        assert not recorder.settle.called
        assert not recorder.close.called


@pytest.mark.parametrize(("role", "alone", "stages"), [("all", True, ""), ("renderer", False, "renderer")])
def test_worker_of_stages_is_there_before_it_pulls(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch, role: str, alone: bool, stages: str
) -> None:
    world, calls = Mock(), fakes.calls
    fakes.put("_world", lambda bus, asked: world)
    fakes.put("check_same_make", lambda *args: calls.append(("check", *args)))
    fakes.put("numeric_class", lambda *args: ("class", *args))
    fakes.put("pull", lambda bus, who, *, leave: calls.append(("pull", bus, who, leave())) or True)
    monkeypatch.setattr("readygo.runs.warm.warm_once", lambda: calls.append(("warm",)))
    monkeypatch.setattr("readygo.runs.stages.stage_works", lambda *args: args)
    fakes.observer.works.side_effect = lambda works: {"works": works}
    fakes.bus.announce.side_effect = lambda *who: calls.append(("there", *who)) or "first"
    assert _work(fakes.bus, role, "w7", lambda: True, fakes.observer, alone=alone)
    me = Worker(
        name="w7",
        numeric_class=("class", world.config, world.spec.policy, world.spec.teacher),  # type: ignore[arg-type]
        works={"works": (world, fakes.bus, stages)},  # type: ignore[dict-item]
        role=role,
        session="first",
    )
    first = [("check", world.spec, world.config), ("warm",)] if alone else []
    assert calls == [*first, ("there", role, "w7"), ("pull", fakes.bus, me, True)]
    world.forget_avatars.assert_called_once_with()


@pytest.mark.parametrize(("role", "disk"), [("coordinator", True), ("recorder", True), ("renderer", False)])
def test_part_in_a_run_is_taken_on_a_bus_of_its_own_that_is_closed(
    fakes: Fakes, tmp_path: Path, role: str, disk: bool
) -> None:
    shown, data = fakes.bus, (tmp_path,)
    fakes.put("_folder", lambda *args: ("folder", *args))
    for name in ("_coordinate", "_record", "_work"):
        fakes.put(name, lambda *args, name=name, **named: fakes.calls.append((name, args, named)) or True)
    leave, part = lambda: False, fakes.part(role, tmp_path)
    assert _take_part(part, "run-1", leave, alone=True)  # type: ignore[arg-type]
    folder = ("folder", role, data)
    wanted = {
        "coordinator": ("_coordinate", (shown, folder, fakes.stop, fakes.observer), {}),
        "recorder": ("_record", (shown, "w7", folder, fakes.stop, fakes.observer), {"alone": True}),
        "renderer": ("_work", (shown, role, "w7", leave, fakes.observer), {"alone": True}),
    }
    health = {"data": tmp_path if disk else None, "metrics": fakes.observer.metrics_at}
    assert fakes.calls == [("join", "run-1"), ("health", (shown, role, "w7"), health), wanted[role]]
    fakes.bus.close.assert_called_once_with()


@pytest.mark.parametrize("role", ["recorder", "renderer"])
def test_several_runs_are_served_from_a_folder_for_each(
    fakes: Fakes, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, role: str
) -> None:
    calls = fakes.calls
    monkeypatch.setattr("readygo.runs.warm.warm_once", lambda: calls.append(("warm",)))
    fakes.put("_folder", lambda *_: SimpleNamespace(path=tmp_path))
    fakes.put("Runs", lambda bus, **named: ("runs", bus, named))
    fakes.put("_take_part", lambda part, run, leave, *, alone: (part.data, run, leave(), alone))
    serve = lambda which: lambda runs, take, stop: calls.append((which, runs, take("run-3", lambda: True), stop))  # noqa: E731
    fakes.put("record_for", serve("record"))
    fakes.put("work_for", serve("work"))
    _serve_runs(fakes.part(role, tmp_path), ["run-3", "run-4"])  # type: ignore[arg-type]
    runs = ("runs", fakes.bus, {"role": role, "me": "w7", "named": ["run-3", "run-4"]})
    data = (tmp_path / "run-3",) if role == "recorder" else (tmp_path,)
    last = ("record" if role == "recorder" else "work", runs, (data, "run-3", True, True), fakes.stop)
    assert calls == [*([] if role == "recorder" else [("warm",)]), ("join", ANY_RUN), last]
    fakes.bus.close.assert_called_once_with()
