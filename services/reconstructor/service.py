"""The reconstructor on the bus: a worker that claims jobs, and the desk that has them."""

import json
import threading
from pathlib import Path

from readygo.common.bus import Bus
from readygo.common.errors import PeerError, ReadygoError
from readygo.common.messages import (
    ReconstructionClaim,
    ReconstructionJob,
    ReconstructionProgress,
    ReconstructionReport,
    topics,
)
from readygo.common.messages.reconstruction import RECONSTRUCTOR
from readygo.services.reconstructor.desk import Desk, config_of
from readygo.services.reconstructor.reconstruct import STAGES, Job, reconstruct_scene
from readygo.services.reconstructor.stages import StageProgress

ASK_S = 1.0
"""How often a worker without work asks for some [s]."""


def attach(bus: Bus, desk: Desk) -> None:
    """Give out a desk's job, and again when the worker that has it is gone."""
    bus.serve(topics.RECONSTRUCTION_CLAIM, desk.claim)
    bus.serve(topics.RECONSTRUCTION_REPORT, desk.report)
    bus.watch(
        lambda member, alive: desk.note_worker(member.name, alive=alive) if member.role == RECONSTRUCTOR else None
    )


def pull_jobs(bus: Bus, name: str, stop: threading.Event) -> None:
    """Claim jobs and do them until there is none left, or until `stop`, which is heard when a stage says something.

    Raises:
        BusError: If no process answers.
    """
    bus.announce(RECONSTRUCTOR, name)
    while not stop.is_set():
        job = bus.request(topics.RECONSTRUCTION_CLAIM, ReconstructionClaim(worker=name))
        if job.over:
            return
        if not job.attempt:
            stop.wait(ASK_S)
            continue
        report = _do(bus, name, job, stop)
        if report is not None:
            bus.request(topics.RECONSTRUCTION_REPORT, report)


class _StoppedError(Exception):
    """The worker shall end."""


def _do(bus: Bus, name: str, job: ReconstructionJob, stop: threading.Event) -> ReconstructionReport | None:
    """Do a job; None if the worker was told to stop before the end."""
    speaker = _Speaker(bus, job.attempt, stop)
    what = Job(source=Path(job.source), out=Path(job.out), work=Path(job.work), license=job.license)
    try:
        report = reconstruct_scene(what, config_of(job), speaker.say)
    except _StoppedError:
        return None
    except PeerError:
        raise
    except ReadygoError as error:
        return ReconstructionReport(worker=name, attempt=job.attempt, failed=str(error))
    return ReconstructionReport(worker=name, attempt=job.attempt, report=json.dumps(report))


class _Speaker:
    """Publishes how far a job is."""

    def __init__(self, bus: Bus, attempt: int, stop: threading.Event) -> None:
        self._bus, self._attempt, self._stop = bus, attempt, stop
        self._shown: Path | None = None

    def say(self, progress: StageProgress) -> None:
        """Tell everybody who listens, with a picture that was not sent yet."""
        if self._stop.is_set():
            raise _StoppedError
        picture = b""
        if progress.picture is not None and progress.picture != self._shown and progress.picture.is_file():
            self._shown, picture = progress.picture, progress.picture.read_bytes()
        message = ReconstructionProgress(
            attempt=self._attempt,
            stage=progress.stage,
            number=STAGES.index(progress.stage) + 1,
            stages=len(STAGES),
            share=progress.share,
            words=progress.words,
            picture=picture,
        )
        self._bus.publish(topics.RECONSTRUCTION, message)
