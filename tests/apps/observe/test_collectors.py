import math
from pathlib import Path

from readygo.apps.fleet.fleet import FleetMember
from readygo.apps.observe.collectors import of_coordinator, of_launcher, of_recorder
from readygo.common.messages.stages import HUMAN_PLAN, RENDER
from readygo.services.recorder import Recorder, RecorderConfig
from tests.common.dataset.episodes import PROVENANCE, append_requests
from tests.services.coordinator.line import Line
from tests.services.recorder.by_hand import send
from tests.services.recorder.coordinator import FakeCoordinator


def test_stages_without_episodes_and_roles_without_workers_are_zero(tmp_path: Path) -> None:
    line = Line(tmp_path)
    rows = {(name, *labels.values()): value for name, _, labels, value in of_coordinator(line.coordinator)()}
    assert rows["readygo_episodes_waiting", "human-plan"] == 3
    assert rows["readygo_episodes_waiting", "render"] == 0
    assert rows["readygo_workers", "renderer"] == 0
    line.coordinator.troubles["rec0"] = "No space left."
    rows = {(name, *labels.values()): value for name, _, labels, value in of_coordinator(line.coordinator)()}
    assert rows["readygo_run_trouble",] == 1
    line.coordinator.ledger.close()


def test_members_that_come_later_are_shown(tmp_path: Path) -> None:
    members = [FleetMember(role="renderer", name="renderer0", log=tmp_path, restarts=2)]
    rows = of_launcher(members)
    members.append(FleetMember(role="renderer", name="renderer1", log=tmp_path))
    assert [(labels["member"], value) for _, _, labels, value in rows()] == [("renderer0", 2), ("renderer1", 0)]


def test_rows_of_a_coordinator_are_the_numbers_of_its_run(tmp_path: Path) -> None:
    line = Line(tmp_path, wanted=4)
    coordinator = line.coordinator
    for role, name in (("renderer", "w"), ("renderer", "r1"), ("animator", "a0"), ("monitor", "m")):
        coordinator.roster.note_presence(role, name, alive=True)
    line.plan()
    line.record(line.claim(RENDER))
    line.plan()
    line.claim(RENDER, role="renderer")
    line.claim(HUMAN_PLAN, role="renderer")
    coordinator.ledger.set_aside(3, "it is foggy")
    line.now_s += 7.0
    rows = {(name, *labels.values()): value for name, _, labels, value in of_coordinator(coordinator)()}
    free, size = (rows.pop((name,)) for name in ("readygo_disk_free_bytes", "readygo_disk_size_bytes"))
    assert 0 < free <= size
    silent_s = rows.pop(("readygo_lease_silent_seconds",))
    assert math.isfinite(silent_s)
    assert rows == {
        ("readygo_episodes_wanted",): 4, ("readygo_episodes_committed",): 1, ("readygo_samples_committed",): 10,
        ("readygo_episodes_waiting", "human-plan"): 0, ("readygo_episodes_waiting", "animate"): 0,
        ("readygo_episodes_waiting", "robot-plan"): 0, ("readygo_episodes_waiting", "render"): 0,
        ("readygo_episodes_leased", "human-plan"): 1, ("readygo_episodes_leased", "animate"): 0,
        ("readygo_episodes_leased", "robot-plan"): 0, ("readygo_episodes_leased", "render"): 1,
        ("readygo_episodes_rejected",): 1, ("readygo_episodes_aside",): 1, ("readygo_leases_requeued_total",): 0,
        ("readygo_workers", "animator"): 1, ("readygo_workers", "human-planner"): 0, ("readygo_workers", "monitor"): 1,
        ("readygo_workers", "renderer"): 2, ("readygo_workers", "robot-planner"): 0, ("readygo_run_trouble",): 0,
        ("readygo_run_paused",): 0, ("readygo_run_failed",): 0, ("readygo_run_finished",): 0,
    }  # fmt: skip
    coordinator.ledger.close()


def test_rows_of_a_recorder_are_what_it_holds(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, "r0", FakeCoordinator().bus, PROVENANCE, RecorderConfig(fsync=False))
    send(recorder, append_requests(0))
    first = append_requests(1)[0]
    send(recorder, [first])
    recorder._trouble = "full"
    rows = {name: value for name, _, _, value in of_recorder(recorder)()}
    assert rows.pop("readygo_disk_free_bytes") <= rows.pop("readygo_disk_size_bytes")
    assert rows == {
        "readygo_recorder_episodes": 1,
        "readygo_recorder_buffered_episodes": 1,
        "readygo_recorder_buffered_bytes": sum(sample.images_size_bytes for sample in first.samples),
        "readygo_recorder_refused": 1,
    }
    recorder._trouble = ""
    assert {tuple(labels.items()) for _, _, labels, _ in of_recorder(recorder, {"run": "a"})()} == {(("run", "a"),)}
    recorder.close()
