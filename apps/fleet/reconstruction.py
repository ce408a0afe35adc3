"""A reconstruction by a worker, on this machine or another one with the same paths."""

import sys
from typing import Any

from readygo.common.bus.zenoh_bus import Router, ZenohBus
from readygo.common.messages import ReconstructionProgress, topics
from readygo.common.messages.reconstruction import RECONSTRUCTOR
from readygo.services.reconstructor import ASK_S, Desk, Job, ReconstructorConfig, Say, StageProgress, attach

_LEAVE_S = 2.0 * ASK_S
"""Time for the worker to learn that there are no further jobs [s]."""


def ask_worker(job: Job, config: ReconstructorConfig, listen: str, say: Say) -> dict[str, Any]:
    """Wait until a worker has done a job; if a worker is lost, another one resumes the job.

    Args:
        job: Source and folders of the reconstruction.
        config: Settings of the reconstruction.
        listen: Endpoint of the router that workers join.
        say: Receiver of the progress.

    Returns:
        The report of the reconstruction, as from `reconstruct`.

    Raises:
        BusError: If the endpoint cannot be opened.
        RunError: If the job fails.
    """
    router = Router(listen)
    try:
        run = f"reconstruct-{job.out.name}"
        bus = ZenohBus(router.endpoint, run)
        try:
            desk = Desk(job, config)
            attach(bus, desk)
            bus.subscribe(topics.RECONSTRUCTION, lambda message: say(_heard(message)))
            sys.stderr.write(f"waiting for: readygo worker {RECONSTRUCTOR} --connect {listen} --run {run}\n")
            return _wait_for_report(desk)
        finally:
            bus.close()
    finally:
        router.close()


def _wait_for_report(desk: Desk) -> dict[str, Any]:
    # Short waits, so that Ctrl-C takes effect between them.
    try:
        while (report := desk.wait(ASK_S)) is None:
            pass
        return report
    finally:
        desk.wait_dismissed(_LEAVE_S)


def _heard(message: ReconstructionProgress) -> StageProgress:
    return StageProgress(stage=message.stage, share=message.share, words=message.words)
