"""One worker process of a fleet: `readygo worker ROLE`."""

import contextlib
import ctypes
import logging
import os
import signal
import socket
import sys
import threading
from pathlib import Path
from typing import Literal

from readygo.apps.run.config import RunFolder, numeric_class
from readygo.apps.run.stages import stage_work
from readygo.apps.run.world import World
from readygo.common.bus import pull
from readygo.common.bus.zenoh_bus import ZenohBus
from readygo.common.dataset.provenance import Provenance
from readygo.common.errors import RunError
from readygo.common.messages import RunSpec, RunSpecRequest, Stage
from readygo.common.rasterizer.warm import warm as warm_rasterizer
from readygo.services import coordinator as coordination
from readygo.services.recorder import Recorder
from readygo.services.recorder import attach as attach_recorder

Role = Literal["coordinator", "human-planner", "animator", "robot-planner", "renderer", "recorder"]

ROLE_STAGE: dict[str, Stage] = {
    "human-planner": Stage.HUMAN_PLAN,
    "animator": Stage.ANIMATE,
    "robot-planner": Stage.ROBOT_PLAN,
    "renderer": Stage.RENDER,
}
SETTLE_S = 0.5
"""How often the recorder repeats reports that the coordinator has not acknowledged [s]."""
TICK_S = 0.2
"""How often the coordinator looks for leases that ran out [s]."""


def worker(
    role: Role,
    /,
    *,
    connect: str,
    run: str,
    name: str = "",
    data: Path | None = None,
    exit_with_parent: bool = False,
) -> None:
    """Work in a fleet until the run is over, or until SIGTERM.

    Args:
        role: What to do.
        connect: Endpoint of the fleet's router, such as tcp/127.0.0.1:7447.
        run: Name of the run, as `readygo generate --listen` prints it.
        name: Name of this worker; must differ between workers of one role.
        data: Data folder of the run (coordinator and recorder only).
        exit_with_parent: Exit as soon as standard input is closed.
    """
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    _keep_the_heap_small()
    stop = _stop_signal(exit_with_parent)
    name = name or f"{role}-{socket.gethostname()}-{os.getpid()}"
    bus = ZenohBus(connect, run)
    try:
        if role == "coordinator":
            _coordinate(bus, _folder(role, data), stop)
        elif role == "recorder":
            _record(bus, name, _folder(role, data), stop)
        else:
            _work(bus, ROLE_STAGE[role], role, name, stop)
    finally:
        bus.close()


def _keep_the_heap_small() -> None:
    """Have arrays above 256 kB return to the system when they are freed: 30 MB of every renderer.

    By default glibc keeps them for later from the first freed array of such a size on.
    """
    with contextlib.suppress(OSError, AttributeError):
        # -3 is M_MMAP_THRESHOLD.
        ctypes.CDLL(None).mallopt(-3, 1 << 18)


def make_coordinator(folder: RunFolder) -> coordination.Coordinator:
    """The coordinator of the run in a data folder."""
    spec, wanted = folder.load()
    scene = Path(spec.scene_path)
    files = {file.sha256: scene / file.path for file in spec.scene_files}
    return coordination.Coordinator(
        spec=spec,
        wanted=wanted,
        ledger=coordination.Ledger(folder.ledger),
        blobs=coordination.BlobStore(folder.blobs, files),
        recorders=("rec0",),
    )


def _coordinate(bus: ZenohBus, folder: RunFolder, stop: threading.Event) -> None:
    coordinator = make_coordinator(folder)

    def changed(role: str, name: str, alive: bool) -> None:
        if not alive:
            coordination.requeue_lost(coordinator, worker=name)

    coordination.attach(bus, coordinator)
    bus.watch(changed)
    bus.announce("coordinator", "coordinator")
    while not stop.wait(TICK_S):
        coordination.requeue_lost(coordinator)


def _record(bus: ZenohBus, name: str, folder: RunFolder, stop: threading.Event) -> None:
    world = World(bus.request("coord/spec", RunSpecRequest(), RunSpec, timeout_s=30.0))
    recorder = Recorder(
        folder=folder.path, name=name, bus=bus, provenance=Provenance.of_run(world.spec), config=world.config.recorder
    )
    attach_recorder(bus, recorder)
    bus.announce("recorder", name)
    while not stop.wait(SETTLE_S):
        recorder.settle()
    recorder.close()


def _work(bus: ZenohBus, stage: Stage, role: str, name: str, stop: threading.Event) -> None:
    world = World(bus.request("coord/spec", RunSpecRequest(), RunSpec, timeout_s=30.0), bus)
    if stage is Stage.RENDER:
        # One renderer compiles while the others wait.
        warm_rasterizer()
    work = stage_work(stage, world, bus)
    world.forget_avatars()
    bus.announce(role, name)
    pull(bus, stage, name, numeric_class(world.config), work, stop=stop)


def _folder(role: str, data: Path | None) -> RunFolder:
    if data is None:
        raise RunError(f"A {role} needs the run's data folder: pass --data.")
    return RunFolder(data)


def _stop_signal(exit_with_parent: bool) -> threading.Event:
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    if exit_with_parent:
        # Ctrl-C reaches the whole process group; the parent alone decides what its fleet does then.
        signal.signal(signal.SIGINT, signal.SIG_IGN)

        def watch_parent() -> None:
            # The raw descriptor: a daemon thread inside of a buffered read breaks the interpreter's shutdown.
            while os.read(0, 1):
                pass
            stop.set()
            # The parent is gone, and with it the router: nobody is left to finish work for.
            late = threading.Timer(10.0, lambda: os._exit(1))
            late.daemon = True
            late.start()

        threading.Thread(target=watch_parent, name="parent", daemon=True).start()
    return stop
