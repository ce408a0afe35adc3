import dataclasses
import io
import time

from readygo.apps.observe.status import Look, Observed, left_s, runs_table, status_table
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
    assert "about 5 min left; paused, `readygo resume` goes on" in text
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
    look = Look(bus)
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
