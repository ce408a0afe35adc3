"""A run whose workers and recorder share no files with its coordinator, over mTLS, one of them cut off for a while."""

import contextlib
import dataclasses
import shutil
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

pytest.importorskip("cryptography", reason="needs the extra tls")

from readygo.apps.fleet import lead as leading
from readygo.apps.fleet import worker
from readygo.apps.fleet.access import join, open_router
from readygo.apps.fleet.certificates import issue, make_authority
from readygo.apps.fleet.lead import lead
from readygo.apps.fleet.worker import make_coordinator, make_recorder, take_the_lead
from readygo.apps.observe.observer import ProcessObserver
from readygo.apps.observe.settings import NOTHING
from readygo.common.bus import Member
from readygo.common.bus.zenoh_bus import Router, free_endpoint
from readygo.common.dataset import Dataset
from readygo.common.errors import BusError, RunError
from readygo.common.fleet import Worker, pull
from readygo.common.messages import ClaimReply, Command, ControlRequest, RunSpecRequest, topics
from readygo.runs.folder import RunFolder
from readygo.runs.recovery import recover
from readygo.runs.stages import stage_works
from readygo.runs.world import World
from readygo.services.coordinator import Ledger
from readygo.services.recorder import attach as attach_recorder
from tests.apps.fleet.toy_line import DRAW, FILM, draw, entry, in_process, make_folder
from tests.waiting import wait_for

EPISODES = 12
RUN = "run-test"


class Cable:
    """A way to a router that can be pulled out: what is sent then goes nowhere, until it is put in again."""

    def __init__(self, endpoint: str) -> None:
        host, port = endpoint.removeprefix("tls/").rsplit(":", 1)
        self._router = host, int(port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tls/127.0.0.1:{self._listener.getsockname()[1]}"
        self.whole = threading.Event()
        self.whole.set()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
                self.whole.wait()
                far = socket.create_connection(self._router)
            except OSError:
                return
            for ends in ((near, far), (far, near)):
                threading.Thread(target=self._carry, args=ends, daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                self.whole.wait()
                sink.sendall(data)
        except OSError:
            pass
        for end in (source, sink):
            with contextlib.suppress(OSError):
                # Whoever reads from it goes on, and closes it as well.
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def close(self) -> None:
        self.whole.set()
        self._listener.close()


@pytest.fixture
def certs(tmp_path: Path) -> Path:
    folder = tmp_path / "certs"
    make_authority(folder)
    for name in ("coordinator", "all", "recorder.rec0", "operator"):
        issue(folder, folder, name, hosts=("127.0.0.1",))
    return folder


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(8) as pool:
        yield pool


def _record(endpoint: str, certs: Path, shards: Path) -> None:
    """A recorder that knows nothing but the bus and its own disk."""
    bus = join(endpoint, RUN, "recorder", name="rec0", certs=certs)
    world = World(bus.request(topics.SPEC, RunSpecRequest(role="recorder"), timeout_s=20.0), bus)
    recorder = make_recorder(bus, "rec0", RunFolder(shards), world)
    attach_recorder(bus, recorder)
    bus.announce("recorder", "rec0")
    over = threading.Event()
    bus.subscribe(topics.PROGRESS, lambda status: over.set() if status.finished or status.failed else None)
    while not over.wait(0.1):
        recorder.settle()
    recorder.close()
    bus.close()


def _work(endpoint: str, certs: Path, name: str, done: list[str], pause_s: float) -> None:
    bus = join(endpoint, RUN, "all", certs=certs)
    world = World(bus.request(topics.SPEC, RunSpecRequest(role="all"), timeout_s=20.0), bus)

    def slow_draw(claim: ClaimReply, inputs):  # type: ignore[no-untyped-def]
        time.sleep(pause_s)
        done.append(name)
        return draw(claim, inputs)

    works = stage_works(world, bus, line=(entry(DRAW.stage, slow_draw), FILM))
    bus.announce("all", name)
    pull(bus, Worker(name=name, numeric_class="this", works=works), leave=lambda: False)
    bus.close()


def test_host_that_is_cut_off_and_healed_changes_nothing_of_the_dataset(
    tmp_path: Path, certs: Path, pool: ThreadPoolExecutor
) -> None:
    folder = make_folder(tmp_path / "coordinator", [DRAW, FILM], wanted=EPISODES, lease_s=2.0)
    listen = free_endpoint().replace("tcp/", "tls/")
    led = pool.submit(lead, folder, listen, certs=certs)
    wait_for((folder.state / "endpoint").exists)
    cable = Cable(listen)
    done: list[str] = []
    recorded = pool.submit(_record, listen, certs, tmp_path / "recorder")
    workers = [
        # Slow, so that work is left when the other one is back.
        pool.submit(_work, listen, certs, "near", done, 1.0),
        pool.submit(_work, cable.endpoint, certs, "far", done, 0.05),
    ]
    wait_for(lambda: "far" in done)
    cable.whole.clear()
    cut = done.count("far")
    time.sleep(3.0)
    assert done.count("far") <= cut + 1
    cable.whole.set()
    status = led.result(timeout=60)
    for future in (recorded, *workers):
        future.result(timeout=60)
    cable.close()
    assert (status.finished, status.committed) == (True, EPISODES)
    # Nothing was recorded where the coordinator is, everything where the recorder is.
    assert not list(folder.path.glob("*.mcap*"))
    alone = make_folder(tmp_path / "alone", [DRAW, FILM], wanted=EPISODES)
    in_process(alone, [DRAW, FILM])
    assert Dataset([tmp_path / "recorder"]).content_hash == Dataset([alone.path]).content_hash
    # Nothing of it is lost, though no shard is here.
    with pytest.raises(RunError, match=r"are on other machines: `readygo coordinator "):
        recover(folder)


def test_only_one_coordinator_leads_a_run(tmp_path: Path, certs: Path) -> None:
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=2)
    listen = free_endpoint().replace("tcp/", "tls/")
    with folder.lock(), pytest.raises(RunError, match=f"Another process is generating into {folder.path}"):
        lead(folder, listen, certs=certs)


def test_coordinator_of_a_fleet_that_is_still_at_work_is_waited_for_and_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=2)
    monkeypatch.setattr(leading, "LATE_S", 0.05)
    with (
        folder.lock_coordinator(patience_s=0.0),
        pytest.raises(RunError, match=f"Another coordinator is at work on {folder.path}"),
    ):
        lead(folder, free_endpoint())


@pytest.mark.parametrize("late_s", [0.0, 1.0])
def test_run_in_a_copied_folder_is_led_once_at_a_router(
    late_s: float, tmp_path: Path, certs: Path, pool: ThreadPoolExecutor
) -> None:
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=2)
    copied = RunFolder(Path(shutil.copytree(folder.path, tmp_path / "copied")))
    listen = free_endpoint().replace("tcp/", "tls/")
    router = open_router(["rec0"], listen, certs=certs, token="")
    started = [pool.submit(lead, folder, listen, joins=True, certs=certs)]
    time.sleep(late_s)
    started.append(pool.submit(lead, copied, listen, joins=True, certs=certs))
    refused = next(as_completed(started, timeout=60))
    with pytest.raises(BusError, match="Run run-test is led already by another coordinator at this router, maybe in a"):
        refused.result()
    # The other one leads on.
    _cancel(listen, certs)
    started.remove(refused)
    with pytest.raises(RunError, match="cancelled"):
        started[0].result(timeout=60)
    router.close()


def test_coordinator_that_was_replaced_while_it_was_cut_off_stops_when_it_is_back(
    tmp_path: Path, certs: Path, pool: ThreadPoolExecutor
) -> None:
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=2)
    listen = free_endpoint().replace("tcp/", "tls/")
    router = open_router(["rec0"], listen, certs=certs, token="")
    cable = Cable(listen)
    bus = join(listen, RUN, "operator", certs=certs)
    leaders: set[str] = set()
    there: list[bool] = []
    """Whether the run has a coordinator, whenever that changes."""

    def changed(member: Member, alive: bool) -> None:
        (leaders.add if alive else leaders.discard)(member.session)
        if not there or there[-1] != bool(leaders):
            there.append(bool(leaders))

    bus.watch(changed)
    first = pool.submit(lead, folder, cable.endpoint, joins=True, certs=certs)
    wait_for(lambda: there == [True])
    cable.whole.clear()
    wait_for(lambda: there == [True, False])
    copied = RunFolder(Path(shutil.copytree(folder.path, tmp_path / "copied")))
    second = pool.submit(lead, copied, listen, joins=True, certs=certs)
    wait_for(lambda: there == [True, False, True])
    cable.whole.set()
    with pytest.raises(RunError, match="led by a coordinator that was started later, while this one was cut off"):
        first.result(timeout=60)
    assert not second.done()
    _cancel(listen, certs)
    with pytest.raises(RunError, match="cancelled"):
        second.result(timeout=60)
    # Nobody saw the run without a coordinator in between.
    wait_for(lambda: not there[-1])
    assert there.count(False) == 2
    cable.close()
    bus.close()
    router.close()


def test_coordinator_answers_nobody_before_it_leads(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=2)
    bus = Mock(announce=Mock(side_effect=BusError("taken")))
    coordinator = make_coordinator(folder)
    with pytest.raises(BusError, match="is led already"):
        take_the_lead(bus, coordinator)
    coordinator.ledger.close()
    with pytest.raises(BusError, match="is led already"):
        worker._coordinate(bus, folder, threading.Event(), ProcessObserver(NOTHING, run="", role="", name=""))
    bus.serve.assert_not_called()


def test_leader_prepares_disks_and_leaves_out_recorders_that_were_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = {name: str(tmp_path / name) for name in ("rec0", "rec1")}
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=2, recorders=tuple(own), folders=own)
    ledger = Ledger(folder.ledger, folder.load()[0].stages)
    ledger.retire("rec1")
    ledger.close()
    opened: list[tuple[str, ...]] = []

    def open_noted(recorders: tuple[str, ...], listen: str, **how: Any) -> Router:
        opened.append(recorders)
        return open_router(recorders, listen, **how)

    monkeypatch.setattr(leading, "open_router", open_noted)
    monkeypatch.setattr(leading, "take_the_lead", Mock(side_effect=BusError("is led already")))
    with pytest.raises(BusError, match="is led already"):
        lead(folder, free_endpoint())
    assert opened == [("rec0",)]
    assert folder.place_of("rec0") == tmp_path / "rec0"
    assert not (tmp_path / "rec1").exists()


def test_leader_refuses_a_run_whose_ledger_is_lost(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=2)
    folder.blobs.mkdir()
    with pytest.raises(RunError, match=r"ledger\.sqlite is gone"):
        lead(folder, free_endpoint())


def test_name_that_is_taken_is_refused(tmp_path: Path, certs: Path, pool: ThreadPoolExecutor) -> None:
    folder = make_folder(tmp_path / "data", [DRAW, FILM], wanted=2)
    listen = free_endpoint().replace("tcp/", "tls/")
    led = pool.submit(lead, folder, listen, certs=certs)
    wait_for((folder.state / "endpoint").exists)
    with contextlib.ExitStack() as left:
        left.callback(_cancel, listen, certs)
        first, second = (join(listen, RUN, "all", certs=certs) for _ in range(2))
        for bus in (first, second):
            left.callback(bus.close)
        first.announce("all", "w")
        with pytest.raises(BusError, match=r"Another all of the run is called 'w': choose another --name\."):
            second.announce("all", "w")
    with pytest.raises(RunError, match="cancelled"):
        led.result(timeout=60)


def _cancel(listen: str, certs: Path) -> None:
    operator = join(listen, RUN, "operator", certs=certs)
    operator.request(topics.CONTROL, ControlRequest(command=Command.CANCEL))
    operator.close()


@pytest.mark.parametrize("joins", [False, True])
def test_endpoint_that_cannot_be_used_binds_nothing(joins: bool, tmp_path: Path) -> None:
    folder = make_folder(tmp_path, (DRAW, FILM), wanted=3)
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        unused = free_endpoint()
        with pytest.raises(BusError, match="No router answers" if joins else "the port is in use"):
            lead(folder, unused if joins else taken, joins=joins)
    spec, _ = folder.load()
    folder.check(dataclasses.replace(spec, seed=spec.seed + 1))


@pytest.mark.parametrize(("stays", "ticks"), [(0, 3), (2, 5), (99, 8)])
def test_leader_stays_until_all_have_left_or_had_their_time(
    monkeypatch: pytest.MonkeyPatch, stays: int, ticks: int
) -> None:
    done: list[str] = []
    bus, now_s = Mock(), [100.0]
    coordinator = SimpleNamespace(over=False)

    def tick(*_: object) -> None:
        done.append("tick")
        now_s[0] += 7.0
        (changed,) = bus.watch.call_args.args
        changed(Member("renderer", "r0", "s"), len(done) < 3 + stays)
        coordinator.over = len(done) >= 3

    status = SimpleNamespace(failed="", committed=3, wanted=5)
    service = SimpleNamespace(attach=Mock(), tick=tick, handle_status=lambda *_: status)
    bus.watch.side_effect = lambda changed: changed(Member("coordinator", "coordinator", "s"), True)
    monkeypatch.setattr(leading, "coordination", service)
    monkeypatch.setattr(leading, "TICK_S", 0.0)
    monkeypatch.setattr(leading.time, "monotonic", lambda: now_s[0])
    led: list[int] = []
    assert leading._until_over(bus, coordinator, lambda: led.append(1)) is status  # type: ignore[arg-type]
    assert (len(done), len(led)) == (ticks, ticks)
    status.failed = "The disk is full."
    with pytest.raises(RunError, match=r"The disk is full\. \(3 of 5 episodes are recorded\.\)"):
        leading._until_over(bus, coordinator, lambda: None)  # type: ignore[arg-type]
