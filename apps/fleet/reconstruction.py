"""A reconstruction that a worker does, on this machine or another one that sees the same paths."""

import sys
from typing import Any, Protocol

from readygo.common.bus.zenoh_bus import Router, ZenohBus
from readygo.common.messages import ReconstructionProgress, topics
from readygo.common.messages.reconstruction import RECONSTRUCTOR
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.desk import Desk
from readygo.services.reconstructor.reconstruct import Job
from readygo.services.reconstructor.service import ASK_S, attach
from readygo.services.reconstructor.stages import StageProgress

_LEAVE_S = 2.0 * ASK_S
"""Time that the worker has to hear that nothing more will come [s]."""


class Listener(Protocol):
    """Who hears of progress."""

    def say(self, progress: StageProgress) -> None:
        """Hear of it."""
        ...


def ask_worker(job: Job, config: ReconstructorConfig, listen: str, listener: Listener) -> dict[str, Any]:
    """Wait until a worker has done a job; another one goes on where one was lost.

    Args:
        job: What of what.
        config: How.
        listen: Endpoint of the router that workers join.
        listener: Hears how far it is.

    Returns:
        The report, as of `reconstruct`.

    Raises:
        BusError: If nothing can listen there.
        RunError: If the job cannot be done.
    """
    router = Router(listen)
    try:
        run = f"reconstruct-{job.out.name}"
        bus = ZenohBus(router.endpoint, run)
        try:
            desk = Desk(job, config)
            attach(bus, desk)
            bus.subscribe(topics.RECONSTRUCTION, lambda message: listener.say(_heard(message)))
            sys.stderr.write(f"waiting for: readygo worker {RECONSTRUCTOR} --connect {listen} --run {run}\n")
            return _waited(desk)
        finally:
            bus.close()
    finally:
        router.close()


def _waited(desk: Desk) -> dict[str, Any]:
    # Short waits: Ctrl-C is heard between them.
    try:
        while (report := desk.wait(ASK_S)) is None:
            pass
        return report
    finally:
        desk.dismissed(_LEAVE_S)


def _heard(message: ReconstructionProgress) -> StageProgress:
    return StageProgress(stage=message.stage, share=message.share, words=message.words)
