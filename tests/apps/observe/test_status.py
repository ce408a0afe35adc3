import dataclasses
import io
import re
import time
from collections.abc import Callable

import pytest

from readygo.apps.observe.status import Observed, RunStatus, duration, left_s, runs_table, status_table
from readygo.apps.terminal import PlainConsole
from readygo.common.bus import InProcessBus
from readygo.common.messages import StatusReply, topics
from readygo.common.messages.fleet import FleetReply, HeldLease, WorkerState
from readygo.common.messages.live import LiveHealth

STATUS = StatusReply(
    wanted=100,
    committed=40,
    samples=4000,
    waiting={"render": 3},
    leased={"render": 2},
    rejected={"no scenario": 4},
    requeued=1,
    cpu_s={"render": 12.5},
    finished=False,
    paused=True,
    trouble="No space left in /data.",
)


def worker(role: str, name: str, silent_s: float, *holds: HeldLease) -> WorkerState:
    return WorkerState(role=role, name=name, silent_s=silent_s, done=5, failed=0, holds=holds)


def lease(index: int) -> HeldLease:
    return HeldLease(stage="render", index=index, attempt=1, held_s=30.0)


def health(uptime_s: float, cpu_s: float, free: int = 2 * 10**9) -> LiveHealth:
    return LiveHealth(
        role="recorder",
        name="rec0",
        host="lab1",
        pid=7,
        uptime_s=uptime_s,
        cpu_s=cpu_s,
        memory_bytes=68_000_000,
        disk_free_bytes=free,
        disk_size_bytes=10**11,
        metrics="127.0.0.1:9464",
    )


FLEET = FleetReply(
    stages=("human-plan", "render"),
    workers=(
        worker("", "renderer9", 20.0, lease(8)),
        worker("recorder", "rec0", 99.0),
        worker("renderer", "renderer0", 1.0, lease(11)),
        worker("renderer", "renderer1", 14.0, lease(12)),
    ),
    done_per_minute={"render": 12.0},
)


def shown(observed: Observed) -> list[str]:
    console = PlainConsole(file=io.StringIO(), width=160)
    console.print(status_table(observed))
    return console.file.getvalue().splitlines()  # type: ignore[attr-defined]


def test_time_left_follows_from_what_the_last_stage_does_in_a_minute() -> None:
    assert left_s(Observed(status=STATUS, fleet=FLEET)) == 300.0


def test_table_says_what_is_wrong() -> None:
    lines = shown(Observed(status=STATUS, fleet=FLEET, healths={("recorder", "rec0"): health(1.0, 1.0)}))
    text = "\n".join(lines)
    assert "about 5 min left; paused, `readygo resume` continues" in text
    assert "waits: No space left in /data." in text
    rows = {line.split()[0]: line for line in lines if line.strip()}
    assert "gone, holds render 8" in rows["renderer9"]
    assert "silent for 14 s, holds render 12" in rows["renderer1"]
    assert "render 11 for 30 s" in rows["renderer0"]
    assert rows["render"].split() == ["render", "3", "2", "12.0", "12.5"]
    assert rows["rec0"].split()[-5:] == ["68", "MB", "2.0", "GB", "127.0.0.1:9464"]


def test_cores_in_use_come_from_two_words_of_a_process() -> None:
    coordinator = InProcessBus()
    coordinator.serve(topics.STATUS, lambda request: STATUS)
    coordinator.serve(topics.FLEET, lambda request: FLEET)
    bus = InProcessBus(beside=coordinator)
    look = RunStatus(bus)
    for now_s in (1.0, 3.0):
        bus.publish(topics.HEALTH.of("recorder", "rec0"), health(now_s, now_s / 2))
    deadline_s = time.monotonic() + 10.0
    while not look.now().cpu and time.monotonic() < deadline_s:
        time.sleep(0.01)
    bus.close()
    assert look.now().cpu == {("recorder", "rec0"): 0.5}


def test_names_are_shown_as_they_are() -> None:
    name = "[/x] [link=http://evil.example]"
    status = dataclasses.replace(STATUS, run=name, waiting={name: 1}, rejected={f"\x1b[2J{name}": 1})
    fleet = FleetReply(stages=(name,), workers=(worker(name, name, 1.0, lease(8)),), done_per_minute={})
    said = dataclasses.replace(health(1.0, 1.0), metrics=name)
    text = "\n".join(shown(Observed(status=status, fleet=fleet, healths={(name, name): said})))
    assert text.count(name) == 4
    assert "\x1b" not in text
    console = PlainConsole(file=io.StringIO(), width=160)
    console.print(runs_table([status]))
    assert name in console.file.getvalue()  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (119.6, "120 s"), (120.0, "2 min"), (7199.0, "120 min"), (7200.0, "2.0 h"), (9000.0, "2.5 h")],
)
def test_times_are_told_in_a_unit_that_fits(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_tables_look_as_they_did(golden_page: Callable[[str, str], None]) -> None:
    held = (lease(8), dataclasses.replace(lease(9), held_s=500.0))
    workers = (
        WorkerState(role="renderer", name="r0", silent_s=10.0, done=0, failed=0, holds=held),
        WorkerState(role="renderer", name="r1", silent_s=10.1, done=12, failed=3, holds=held[:1]),
        WorkerState(role="", name="gone", silent_s=1.0, done=0, failed=0, holds=held[1:]),
        WorkerState(role="recorder", name="rec0", silent_s=99.0, done=0, failed=0, holds=()),
        WorkerState(role="recorder", name="rec1", silent_s=99.0, done=0, failed=0, holds=()),
    )
    fleet = FleetReply(stages=("human-plan", "render"), workers=workers, done_per_minute={"render": 7.26})
    full = health(1.0, 1.0, free=4_999_999_999)
    status = dataclasses.replace(
        STATUS, rejected={f"reason {k}": k for k in range(12)}, kept={"timeout": 5}, policies=3, failed="cancelled",
        waiting={"human-plan": 2, "render": 3}, cpu_s={"render": 12.56},
    )  # fmt: skip
    healths = {("recorder", "rec0"): full, ("renderer", "r0"): dataclasses.replace(full, disk_size_bytes=0)}
    shown_all = shown(Observed(status=status, fleet=fleet, healths=healths, cpu={("renderer", "r0"): 0.876}))
    plain = dataclasses.replace(STATUS, trouble="", paused=False, requeued=0, rejected={}, finished=True)
    shown_plain = shown(Observed(status=plain, fleet=dataclasses.replace(fleet, workers=())))
    console = PlainConsole(file=io.StringIO(), width=160)
    runs = [
        dataclasses.replace(plain, run="over", priority=-3), dataclasses.replace(plain, run="on", finished=False),
        dataclasses.replace(status, run="failed"), dataclasses.replace(STATUS, run="paused"),
        dataclasses.replace(STATUS, run="waits", paused=False),
    ]  # fmt: skip
    console.print(runs_table(runs))
    console.print(runs_table([]))
    lines = [*shown_all, "", *shown_plain, "", *console.file.getvalue().splitlines()]
    golden_page("status_tables", "\n".join(line.rstrip() for line in lines))


@pytest.mark.parametrize(("free", "low"), [(4_999_999_999, True), (5_000_000_000, False)])
def test_disk_with_less_than_a_twentieth_of_its_room_is_red(free: int, low: bool) -> None:
    console = PlainConsole(file=io.StringIO(), width=160, force_terminal=True)
    fleet = FleetReply(stages=("render",), workers=(worker("recorder", "rec0", 1.0),), done_per_minute={})
    status = dataclasses.replace(STATUS, trouble="", paused=False)
    observed = Observed(status=status, fleet=fleet, healths={("recorder", "rec0"): health(1.0, 1.0, free=free)})
    assert left_s(observed) is None
    console.print(status_table(observed))
    assert bool(re.search(r"\x1b\[31m *5\.0 GB", console.file.getvalue())) == low


def test_cores_are_not_told_of_a_process_that_was_started_anew_or_a_clock_that_stands() -> None:
    look = RunStatus(InProcessBus())
    who = ("recorder", "rec0")
    for one in (health(5.0, 1.0), health(5.0, 2.0), dataclasses.replace(health(9.0, 0.5), pid=8)):
        look._hear(one)
        assert look._cpu == {}
    look._hear(dataclasses.replace(health(11.0, 2.0), pid=8))
    assert look._cpu == {who: 0.75}
