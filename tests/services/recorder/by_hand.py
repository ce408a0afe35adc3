"""A recorder, driven by hand."""

from pathlib import Path

from readygo.common.messages import AppendRequest
from readygo.services.recorder import Recorder, handle_append


def send(recorder: Recorder, requests: list[AppendRequest]) -> list[str]:
    return [handle_append(recorder, request).status.value for request in requests]


def crash(recorder: Recorder) -> None:
    """Leave everything as a killed process does: its files stay, its lock goes."""
    if recorder._shards._writer is not None:
        recorder._shards._writer.abandon()
    recorder._name_lock.release()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())
