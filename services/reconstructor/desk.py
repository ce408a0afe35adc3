"""Hands a job to one worker at a time, and to another one when that worker is gone. No bus."""

import json
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import parse_json
from readygo.common.errors import RunError
from readygo.common.messages import ReconstructionClaim, ReconstructionJob, ReconstructionReport, Verdict, VerdictStatus
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.reconstruct import Job


class Desk:
    """One job that workers ask for."""

    def __init__(self, job: Job, config: ReconstructorConfig) -> None:
        """Offer a job that no worker holds yet.

        Args:
            job: Its paths are made absolute.
            config: How it is done; so are its paths.
        """
        frames = replace(config.frames, masks=_absolute(config.frames.masks))
        poses = replace(config.poses, intrinsics=_absolute(config.poses.intrinsics))
        self._job = ReconstructionJob(
            source=str(job.source.resolve()),
            out=str(job.out.resolve()),
            work=str(job.work.resolve()),
            license=job.license,
            config=json.dumps(section_to_mapping(replace(config, frames=frames, poses=poses))),
        )
        self._attempt, self._worker = 0, ""
        self._report: ReconstructionReport | None = None
        self._ended, self._dismissed = threading.Event(), threading.Event()

    def claim(self, request: ReconstructionClaim) -> ReconstructionJob:
        """Give the job to a worker if no other worker holds it. One that asks again has lost it."""
        if self._ended.is_set():
            self._dismissed.set()
            return ReconstructionJob(over=True)
        if self._worker not in ("", request.worker):
            return ReconstructionJob()
        self._attempt, self._worker = self._attempt + 1, request.worker
        return replace(self._job, attempt=self._attempt)

    def report(self, report: ReconstructionReport) -> Verdict:
        """Take the result of the attempt that counts."""
        if (report.worker, report.attempt) != (self._worker, self._attempt) or self._ended.is_set():
            return Verdict(status=VerdictStatus.STALE)
        self._report = report
        self._ended.set()
        return Verdict(status=VerdictStatus.OK)

    def note_worker(self, worker: str, *, alive: bool) -> None:
        """Free the job for another worker when its worker is gone; finished stages stay."""
        if worker == self._worker and not alive:
            self._worker = ""

    def wait(self, timeout_s: float) -> dict[str, Any] | None:
        """The report of the job; None if it is not there after the time.

        Raises:
            RunError: If the worker could not do it.
        """
        if not self._ended.wait(timeout_s):
            return None
        assert self._report is not None
        if self._report.failed:
            raise RunError(self._report.failed)
        return dict(parse_json(self._report.report))

    def wait_dismissed(self, timeout_s: float) -> None:
        """Wait until a worker has heard that nothing more will come, or for so long."""
        self._dismissed.wait(timeout_s)


def _absolute(text: str) -> str:
    """The absolute path of a file or folder that is there; other texts as they are: intrinsics may be numbers."""
    return str(Path(text).resolve()) if text and Path(text).exists() else text


def config_of(job: ReconstructionJob) -> ReconstructorConfig:
    """Settings of a job.

    Raises:
        ConfigError: If the settings are those of another version.
    """
    return section_from_mapping(ReconstructorConfig, parse_json(job.config))
