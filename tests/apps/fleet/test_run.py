import dataclasses
import queue
import socket
import threading
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from readygo.apps.fleet import run as module
from readygo.apps.fleet.run import begin, count_recorded, record, run_fleet
from readygo.apps.fleet.worker import make_coordinator, make_recorder
from readygo.common.bus import Bus, InProcessBus
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.dataset import validate
from readygo.common.dataset.casts import read_casts
from readygo.common.errors import BusError, DiskError, RunError
from readygo.common.fleet import Inputs, StageResult, Work, Worker, pull
from readygo.common.messages import ClaimReply, OnRejection, RunSpec, Stage, StatusReply, StatusRequest
from readygo.runs.folder import RunFolder
from readygo.runs.stages import LINE, Entry, stage_works
from readygo.runs.world import World
from readygo.services import coordinator as coordination
from readygo.services.coordinator import Ledger
from readygo.services.coordinator.handlers import handle_status
from readygo.services.recorder import attach as attach_recorder
from tests.apps.fleet.toy_line import DRAW, FILM, entry, film, in_process, make_folder

Run = Callable[[RunFolder, Sequence[Entry]], StatusReply]


def _judge(claim: ClaimReply, inputs: Inputs) -> StageResult:
    """Every third drawing is foul."""
    foul = int(inputs["draw"]) % 3 == 1
    return StageResult(result=b"foul" if foul else b"fair", rejected="foul play" if foul else "")


def _judged(on_rejection: OnRejection) -> tuple[Entry, ...]:
    """The short line with one more stage."""
    judge = Stage(name="judge", role="referee", needs=("draw",), on_rejection=on_rejection)
    return (
        DRAW,
        entry(judge, _judge),
        Entry(stage=dataclasses.replace(FILM.stage, needs=("draw", "judge")), work=film),
    )


def _over_zenoh(folder: RunFolder, line: Sequence[Entry]) -> StatusReply:
    """The run with a worker for every role, each on a bus of its own."""
    router = Router(free_endpoint())
    buses = [ZenohBus(router.endpoint, "run-test") for _ in range(2 + len(line))]
    coordinator = make_coordinator(folder)
    coordination.attach(buses[0], coordinator)
    recorder = make_recorder(buses[1], "rec0", folder, World(coordinator.spec))
    attach_recorder(buses[1], recorder)
    workers = []
    for bus, station in zip(buses[2:], line, strict=True):
        works = stage_works(World(coordinator.spec, bus), bus, station.stage.role, line)
        worker = Worker(name=station.stage.role, numeric_class="any", works=works)
        workers.append(threading.Thread(target=pull, args=(bus, worker), kwargs={"leave": lambda: False}))
        workers[-1].start()
    for thread in workers:
        thread.join(timeout=30.0)
    recorder.close()
    status = handle_status(coordinator, StatusRequest())
    for closable in (*reversed(buses), coordinator.ledger, router):
        closable.close()
    return status


@pytest.fixture(params=[in_process, _over_zenoh], ids=["in process", "over zenoh"])
def run(request: pytest.FixtureRequest) -> Run:
    return request.param  # type: ignore[no-any-return]


def _recorded(folder: RunFolder) -> dict[int, tuple[str, ...]]:
    """What the judge said of every recorded episode, by its index."""
    assert validate(folder.path).defects == ()
    casts = [cast for shard in folder.path.glob("*.mcap") for cast in read_casts(shard)]
    return {cast.episode.index: cast.encounters for cast in casts}


def test_new_stage_whose_rejection_skips_the_index(run: Run, tmp_path: Path) -> None:
    line = _judged(OnRejection.SKIP)
    folder = make_folder(tmp_path / "data", line, wanted=4)
    status = run(folder, line)
    assert (status.finished, status.rejected, status.kept) == (True, {"foul play": 2}, {})
    assert _recorded(folder) == dict.fromkeys((0, 2, 3, 5), ("fair",))


def test_new_stage_whose_rejection_keeps_the_episode_with_its_outcome(run: Run, tmp_path: Path) -> None:
    line = _judged(OnRejection.KEEP)
    folder = make_folder(tmp_path / "data", line, wanted=4)
    status = run(folder, line)
    assert (status.finished, status.rejected, status.kept) == (True, {}, {"foul play": 1})
    assert _recorded(folder) == {0: ("fair",), 1: ("foul",), 2: ("fair",), 3: ("fair",)}


def test_stage_that_records_may_reject_before_it_does(run: Run, tmp_path: Path) -> None:
    def blurred(world: World, bus: Bus) -> Work:
        clear = film(world, bus)

        def work(claim: ClaimReply, inputs: Inputs) -> StageResult | None:
            return StageResult(rejected="blurred view") if int(inputs["draw"]) % 2 else clear(claim, inputs)

        return work

    line = (DRAW, dataclasses.replace(FILM, work=blurred))
    folder = make_folder(tmp_path / "data", line, wanted=3)
    status = run(folder, line)
    assert (status.finished, status.rejected) == (True, {"blurred view": 2})
    assert sorted(_recorded(folder)) == [0, 2, 4]


def test_recorders_share_the_episodes(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "data", (DRAW, FILM), wanted=5, recorders=("rec0", "east"))
    assert in_process(folder, (DRAW, FILM)).finished
    assert sorted(path.name for path in folder.path.glob("*.mcap")) == [
        "shard-east-00000.mcap",
        "shard-rec0-00000.mcap",
    ]
    assert sorted(_recorded(folder)) == [0, 1, 2, 3, 4]


def test_stage_that_this_version_does_not_know_is_named(tmp_path: Path) -> None:
    line = _judged(OnRejection.SKIP)
    folder = make_folder(tmp_path / "data", line, wanted=1)
    with pytest.raises(
        RunError, match="has a stage 'film' that this version does not know; known: human-plan, animate"
    ):
        in_process(folder, LINE)


def test_run_that_is_finished_builds_no_works(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "data", (DRAW, FILM), wanted=1)
    assert in_process(folder, (DRAW, FILM)).finished
    broken = dataclasses.replace(FILM, work=lambda world, bus: pytest.fail("the scene would be loaded"))
    assert in_process(folder, (DRAW, broken)).finished


def test_second_process_changes_nothing_in_the_folder_of_a_running_one(tmp_path: Path) -> None:
    folder = make_folder(tmp_path, (DRAW, FILM), wanted=3)
    spec, _ = folder.load()
    with folder.lock(), pytest.raises(RunError, match="Another process is generating"):
        record(spec, tmp_path, episodes=7, workers=0)
    assert folder.load() == (spec, 3)


@pytest.mark.parametrize("start", [partial(record, episodes=3, workers=0), partial(begin, episodes=3)])
def test_of_two_runs_that_begin_in_a_folder_at_once_the_later_one_is_refused(
    start: Callable[[RunSpec, Path], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec, _ = make_folder(tmp_path / "first", (DRAW, FILM), wanted=3).load()
    folder = RunFolder(tmp_path / "second")
    check = RunFolder.check

    def check_and_be_late(own: RunFolder, wanted: RunSpec) -> None:
        check(own, wanted)
        if not folder.has_data:
            with folder.lock():
                folder.save(spec, 3)
                folder.ledger.touch()

    monkeypatch.setattr(RunFolder, "check", check_and_be_late)
    with pytest.raises(RunError, match="holds data of another run: seed differ"):
        start(dataclasses.replace(spec, seed=spec.seed + 1), folder.path)
    assert folder.load() == (spec, 3)


@pytest.mark.parametrize("start", [partial(record, workers=0), begin])
def test_paused_run_is_started_again_by_its_user_and_not_by_a_supervisor(
    start: Callable[..., object], tmp_path: Path
) -> None:
    folder = make_folder(tmp_path, (DRAW, FILM), wanted=1)
    assert in_process(folder, (DRAW, FILM)).finished
    ledger = Ledger(folder.ledger)
    ledger.notes.put("paused", "yes")
    start(folder.load()[0], tmp_path, episodes=1)
    assert ledger.notes.get("paused") == ("yes" if start is begin else "no")
    ledger.close()


def test_full_disk_is_said_by_its_name_where_one_process_does_everything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_folder(tmp_path, (DRAW, FILM), wanted=1)
    full = Mock(side_effect=DiskError("The run's ledger cannot be used: disk full."))
    monkeypatch.setattr(Ledger, "claim", full)
    with pytest.raises(
        RunError, match=r"No stage can work: The run's ledger .*: disk full\. Mend that; the same comma"
    ):
        in_process(folder, (DRAW, FILM))


def test_endpoint_that_cannot_be_opened_binds_nothing(tmp_path: Path) -> None:
    spec, _ = make_folder(tmp_path / "first", (DRAW, FILM), wanted=3).load()
    folder = RunFolder(tmp_path / "second")
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(BusError, match="the port is in use"):
            record(spec, folder.path, episodes=3, workers=1, listen=taken)
    assert not folder.ledger.exists()
    begin(dataclasses.replace(spec, seed=spec.seed + 1), folder.path, 3)


def test_run_cannot_be_made_shorter_than_what_is_recorded(tmp_path: Path) -> None:
    folder = make_folder(tmp_path, (DRAW, FILM), wanted=4)
    assert in_process(folder, (DRAW, FILM)).finished
    spec, _ = folder.load()
    with pytest.raises(RunError, match=r"holds 4 episodes already.* at least 4 with --episodes"):
        record(spec, tmp_path, episodes=3, workers=0)
    assert folder.load() == (spec, 4)


def test_recorded_episodes_are_counted_also_where_the_ledger_is_damaged(tmp_path: Path) -> None:
    assert count_recorded(tmp_path / "new") == 0
    assert not (tmp_path / "new").exists()
    folder = make_folder(tmp_path / "run", (DRAW, FILM), wanted=4)
    assert count_recorded(folder.path) == 0
    assert in_process(folder, (DRAW, FILM)).finished
    assert count_recorded(folder.path) == 4
    folder.ledger.write_bytes(b"no ledger")
    assert count_recorded(folder.path) == 4


class Noted:
    """Stands in for a part of a fleet; keeps what is asked of all of them, in order."""

    def __init__(self, name: str, said: list[tuple[str, object]]) -> None:
        self._name, self._said = name, said

    def __getattr__(self, what: str) -> Callable[..., object]:
        return lambda *words, **more: self._said.append((f"{self._name}.{what}", (words, more)))


@pytest.fixture
def assembled(monkeypatch: pytest.MonkeyPatch):
    """What `run_fleet` is made of, and what was asked of it."""
    said: list[tuple[str, object]] = []

    def made(name: str, result: object) -> Callable[..., object]:
        return lambda *words, **more: (said.append((name, (words, more))), result)[1]

    class Jobs(Noted):
        def __enter__(self) -> "Jobs":
            return self

        def __exit__(self, *_: object) -> None:
            self._said.append(("jobs.cancel", ((), {})))

    for name, result in (
        ("open_router", Noted("router", said)),
        ("join", Noted("bus", said)),
        ("new_token", "fresh"),
        ("given_token", ""),
        ("SlurmWorkers", Jobs("jobs", said)),
        ("refusals_on_stderr", nullcontext()),
    ):
        monkeypatch.setattr(module, name, made(name, result))
    fleet = Noted("fleet", said)
    fleet.members = ["members"]
    monkeypatch.setattr(module, "Fleet", made("Fleet", fleet))
    monkeypatch.setattr(module, "_observer", lambda folder, observing: nullcontext(Noted("observer", said)))
    return said


def status_of(**changes: object) -> StatusReply:
    values = {
        "wanted": 9, "committed": 3, "samples": 1000, "waiting": {}, "leased": {}, "rejected": {"fog": 2},
        "requeued": 4,
        "cpu_s": {"film": 1.236}, "finished": True, "kept": {"late": 1}, **changes,
    }  # fmt: skip
    return StatusReply(**values)


@pytest.mark.parametrize("slurm", [None, "-p short"])
@pytest.mark.parametrize("certs", [None, Path("certs")])
def test_fleet_is_put_together_as_it_was_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, assembled, slurm: str | None, certs: Path | None
) -> None:
    said = assembled
    folder = make_folder(tmp_path, (DRAW, FILM), wanted=2, recorders=("rec0", "east"))
    folder.state.mkdir(exist_ok=True)
    seen: list[object] = []

    def supervise(checks, bus, show) -> StatusReply:
        seen.append((len(checks), show, folder.fleet_endpoint()))
        return status_of()

    monkeypatch.setattr(module, "_supervise", supervise)
    endpoint, show = "tls/0.0.0.0:7447", lambda status: None
    run_fleet(folder, 3, endpoint, show, slurm=slurm, certs=certs)
    asked = dict(said)
    token = "" if certs else "fresh"
    here, run = "tls/127.0.0.1:7447", folder.load()[0].run
    assert asked["open_router"] == ((("rec0", "east"), endpoint), {"certs": certs, "token": token})
    assert asked["join"] == ((here, run, "coordinator"), {"certs": certs, "token": token})
    made = asked["Fleet"][1]
    assert (made["connect"], made["run"], made["data"], made["logs"]) == (here, run, tmp_path.resolve(), folder.logs)
    assert (made["token"], made["certs"]) == (token, certs)
    added = [words for name, (words, _) in said if name == "fleet.add"]
    roles = [role for role, _ in added]
    assert ("coordinator", "coordinator") in added
    assert {("recorder", "rec0"), ("recorder", "east")} <= set(added)
    assert (set(roles) == {"coordinator", "recorder"}) == (slurm is not None)
    assert seen == [(1 if slurm is None else 2, show, (here, token))]
    assert ("refusals_on_stderr" in asked) == (certs is not None)
    if slurm is not None:
        assert asked["SlurmWorkers"][1] == {
            "connect": endpoint, "run": run, "logs": folder.logs, "options": slurm, "token": token, "certs": certs
        }  # fmt: skip
        assert asked["jobs.submit"] == ((3,), {})
    assert asked["observer.launcher"] == ((["members"],), {})
    order = [name for name, _ in said]
    assert order[-4:] == ["fleet.stop", "bus.close", "router.close", "fleet.check_recorders"]


def test_fleet_that_fails_is_ended_and_its_recorders_are_not_blamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, assembled
) -> None:
    folder = make_folder(tmp_path, (DRAW, FILM), wanted=2)
    folder.state.mkdir(exist_ok=True)

    def fail(checks, bus, show) -> StatusReply:
        raise RunError("it fell")

    monkeypatch.setattr(module, "_supervise", fail)
    with pytest.raises(RunError, match="it fell"):
        run_fleet(folder, 1, "tcp/127.0.0.1:1", lambda status: None)
    assert [name for name, _ in assembled][-3:] == ["fleet.stop", "bus.close", "router.close"]
    with pytest.raises(RunError, match="No fleet is at work"):
        folder.fleet_endpoint()
    monkeypatch.setattr(module, "_supervise", lambda checks, bus, show: status_of(finished=False, failed="cancelled"))
    run_fleet(folder, 1, "tcp/127.0.0.1:1", lambda status: None)
    assert assembled[-1][0] == "router.close"


def test_fleet_is_looked_at_until_the_run_is_over_or_nobody_leads_it(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, shown, checked = [0.0], [], []
    bus = InProcessBus()
    replies = iter([status_of(finished=False), None, status_of(finished=False, failed="full")])

    class Heard:
        def put(self, status: StatusReply) -> None: ...

        def get(self, timeout: float) -> StatusReply:
            now_s[0] += 1.0
            reply = next(replies, None)
            if reply is None:
                raise queue.Empty
            return reply

    monkeypatch.setattr(module, "queue", SimpleNamespace(SimpleQueue=Heard, Empty=queue.Empty))
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    status = module._supervise([lambda: checked.append("a"), lambda: checked.append("b")], bus, shown.append)
    assert (status.failed, len(shown), checked) == ("full", 2, ["a", "b"] * 2)
    with pytest.raises(BusError, match=f"has said nothing for {module.COORDINATOR_ABSENT_S:g} s"):
        module._supervise([], bus, shown.append)
    assert now_s[0] == 3.0 + module.COORDINATOR_ABSENT_S + 1.0


def test_summary_tells_what_this_command_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec, _ = make_folder(tmp_path / "spec", (DRAW, FILM), wanted=2).load()
    times_s = iter([100.0, 112.346])
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: next(times_s)))
    monkeypatch.setattr(module, "_count_recorded", lambda folder, wanted: (1, 400))
    monkeypatch.setattr(module, "run_in_process", lambda folder, show, observing: status_of())
    monkeypatch.setattr(module, "check_recorded", lambda folder: None)
    found = record(spec, tmp_path / "data", episodes=9, workers=0)
    want = {
        "episodes": 3, "samples": 1000, "wall_s": 12.35, "samples_per_s": 48.6, "rejected": {"fog": 2},
        "kept": {"late": 1}, "requeued": 4, "cpu_s": {"film": 1.24}, "data": str(tmp_path / "data"),
    }  # fmt: skip
    assert {name: found[name] for name in want} == want


@pytest.mark.parametrize(
    ("episodes", "workers", "fine"), [(0, 1, False), (1, -1, False), (1, 257, False), (1, 256, True), (1, 0, True)]
)
def test_numbers_of_episodes_and_workers_have_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, episodes: int, workers: int, fine: bool
) -> None:
    monkeypatch.setattr(module, "run_in_process", lambda folder, show, observing: status_of())
    monkeypatch.setattr(module, "run_fleet", lambda *words, **more: status_of())
    monkeypatch.setattr(module, "check_recorded", lambda folder: None)
    spec, _ = make_folder(tmp_path / "spec", (DRAW, FILM), wanted=2).load()
    if fine:
        assert record(spec, tmp_path / "data", episodes=episodes, workers=workers)["episodes"] == 3
        return
    wrong = "--workers must be 0..256" if episodes else "--episodes must be 1..10000000"
    with pytest.raises(RunError, match=f"^{wrong}, got"):
        record(spec, tmp_path / "data", episodes=episodes, workers=workers)
