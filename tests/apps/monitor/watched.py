"""A run on a bus within this process, and a watch that hears it."""

from typing import Any

from readygo.apps.monitor.watch import RunWatch
from readygo.common.bus import InProcessBus
from readygo.common.messages import StatusReply, topics


class Worker:
    """A participant that tells."""

    def __init__(self, run: InProcessBus, role: str, name: str) -> None:
        self.bus = InProcessBus(run)
        self.bus.announce(role, name)

    def tell(self, live: Any, message: Any) -> None:
        self.bus._teller._told_s.clear()
        self.bus.tell(live, lambda: message)


def watched() -> tuple[InProcessBus, RunWatch]:
    """A run and who watches it."""
    run = InProcessBus()
    watch = RunWatch()
    watch.join(InProcessBus(run))
    return run, watch


def status(**changes: Any) -> StatusReply:
    values: dict[str, Any] = {
        "wanted": 10,
        "committed": 2,
        "samples": 400,
        "waiting": {"render": 3},
        "leased": {"render": 1},
        "rejected": {"no_path": 1},
        "requeued": 0,
        "cpu_s": {"render": 5.0},
        "finished": False,
    }
    return StatusReply(**{**values, **changes})


def tell_status(run: InProcessBus, reply: StatusReply) -> None:
    run.publish(topics.PROGRESS, reply)
