import queue
import time
from pathlib import Path

from readygo.common.bus import InProcessBus
from readygo.common.messages import Command, ControlRequest, StatusReply, TroubleRequest, VerdictStatus, Wake, topics
from readygo.common.messages.stages import HUMAN_PLAN, RENDER
from readygo.services.coordinator import tick
from tests.services.coordinator.line import Line
from tests.waiting import wait_for


def test_worker_that_leaves_the_bus_frees_its_leases(line: Line) -> None:
    worker = InProcessBus(line.bus)
    session = worker.announce("human-planner", "w")
    held = line.claim(HUMAN_PLAN, "w", role="human-planner", session=session)
    worker.close()
    deadline_s = time.monotonic() + 5.0
    while line.status().requeued == 0:
        assert time.monotonic() < deadline_s
    assert line.claim(HUMAN_PLAN).attempt == held.attempt + 1


def test_tick_ends_old_leases_and_says_how_far_the_run_is(line: Line) -> None:
    heard: queue.SimpleQueue[StatusReply] = queue.SimpleQueue()
    line.bus.subscribe(topics.PROGRESS, heard.put)
    line.claim(HUMAN_PLAN)
    line.now_s = 100.0
    tick(line.bus, line.coordinator)
    status = heard.get(timeout=5.0)
    assert (status.requeued, status.waiting) == (1, {"human-plan": 3})


def test_who_waits_is_woken_for_its_stage_and_everybody_at_the_end(line: Line) -> None:
    heard: queue.SimpleQueue[Wake] = queue.SimpleQueue()
    line.bus.subscribe(topics.WAKE, heard.put)
    line.complete(HUMAN_PLAN, line.claim(HUMAN_PLAN))
    assert heard.get(timeout=5.0).stages == ("animate",)
    line.bus.request(topics.CONTROL, ControlRequest(command=Command.CANCEL))
    assert heard.get(timeout=5.0).stages == ()


def test_what_has_not_changed_is_said_once_a_second(line: Line) -> None:
    heard: queue.SimpleQueue[StatusReply] = queue.SimpleQueue()
    line.bus.subscribe(topics.PROGRESS, heard.put)
    for now_s in (100.0, 100.5, 101.1):
        line.now_s = now_s
        tick(line.bus, line.coordinator)
    for _ in range(2):
        heard.get(timeout=5.0)
    assert heard.empty()


def test_recorder_that_is_gone_is_told_until_it_comes_back(line: Line) -> None:
    line.plan()
    line.grant(line.claim(RENDER))
    recorder = InProcessBus(line.bus)
    recorder.announce("recorder", "rec0")
    recorder.close()
    wait_for(lambda: "Recorder rec0 is gone and holds 1 episodes" in line.status().trouble)
    again = InProcessBus(line.bus)
    again.announce("recorder", "rec0")
    wait_for(lambda: line.status().trouble == "")
    again.close()


def test_trouble_of_a_recorder_ends_with_its_process(line: Line) -> None:
    for left_in_peace in (True, False):
        recorder, again = InProcessBus(line.bus), InProcessBus(line.bus)
        recorder.announce("recorder", "rec0")
        wait_for(lambda: line.coordinator.roster.size == 1)
        line.bus.request(topics.TROUBLE, TroubleRequest(recorder="rec0", reason="No space left."))
        assert line.status().trouble == "No space left."
        if left_in_peace:
            recorder.close()
        again.announce("recorder", "rec0")
        wait_for(lambda: line.status().trouble == "")
        for bus in (recorder, again):
            bus.close()
        wait_for(lambda: line.coordinator.roster.size == 0)


def test_trouble_of_a_recorder_outlives_the_end_of_another_one(tmp_path: Path) -> None:
    line = Line(tmp_path, recorders=("rec0", "east"))
    recorder = InProcessBus(line.bus)
    recorder.announce("recorder", "east")
    line.bus.request(topics.TROUBLE, TroubleRequest(recorder="rec0", reason="No space left."))
    recorder.close()
    wait_for(lambda: "Recorder east is gone" in line.status().trouble)
    assert "No space left." in line.status().trouble


def test_name_of_another_role_ends_no_lease_and_is_no_recorder(line: Line) -> None:
    claim = line.claim(HUMAN_PLAN, "desk-1", role="human-planner", session="first")
    for role, name in (("animator", "desk-1"), ("animator", "rec0"), ("human-planner", "desk-2")):
        other = InProcessBus(line.bus)
        other.announce(role, name)
        other.close()
    wait_for(lambda: line.coordinator.roster.size == 0)
    assert line.status().trouble == ""
    assert line.complete(HUMAN_PLAN, claim, worker="desk-1", result=b"x") is VerdictStatus.OK


def test_stage_that_nobody_does_is_told_until_somebody_comes(line: Line) -> None:
    for line.now_s in (1.0, 30.0, 62.0):
        tick(line.bus, line.coordinator)
    said = "3 episodes wait for stage human-plan, and no human-planner is there; `readygo worker human-planner` starts"
    assert said in line.status().trouble
    InProcessBus(line.bus).announce("all", "all0")

    def nobody_misses_anybody() -> bool:
        line.now_s += 2.0
        tick(line.bus, line.coordinator)
        return line.status().trouble == ""

    wait_for(nobody_misses_anybody)
