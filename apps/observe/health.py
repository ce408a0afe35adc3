"""Resource use of a process, published once a second while a client subscribes."""

import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from readygo.apps.observe.metrics import private_bytes
from readygo.common.bus import Bus
from readygo.common.files import disk_space
from readygo.common.fleet.repeat import repeating
from readygo.common.messages import topics
from readygo.common.messages.live import LiveHealth

EVERY_S = 1.0


@contextmanager
def showing_health(bus: Bus, role: str, name: str, *, data: Path | None = None, metrics: str = "") -> Iterator[None]:
    """Publish the resource use while the context is active.

    Args:
        bus: Bus on which the process is announced.
        role: Role of the process.
        name: Name of the process.
        data: Folder of its data; None without one.
        metrics: HOST:PORT of its metrics; empty without.
    """
    with repeating(
        lambda: bus.tell(topics.HEALTH, lambda: _health(role, name, data, metrics)), every_s=EVERY_S, name="health"
    ):
        yield


def _health(role: str, name: str, data: Path | None, metrics: str) -> LiveHealth:
    free, size = disk_space(data) if data else (0, 0)
    return LiveHealth(
        role=role,
        name=name,
        host=socket.gethostname(),
        pid=os.getpid(),
        uptime_s=time.monotonic(),
        cpu_s=time.process_time(),
        memory_bytes=private_bytes(),
        disk_free_bytes=free,
        disk_size_bytes=size,
        metrics=metrics,
    )
