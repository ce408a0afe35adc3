"""Fetching what is too large for a reply, and files of a run that a machine lacks."""

import hashlib
import logging
import math
import time
from pathlib import Path

from readygo.common.bus import Bus
from readygo.common.errors import BusError, PeerError, RunError
from readygo.common.files import open_regular
from readygo.common.locks import held
from readygo.common.messages import BlobReply, BlobRequest, FileRef, topics
from readygo.common.messages.codec import MESSAGE_BYTES_MAX

log = logging.getLogger(__name__)

ABSENT_S = 60.0
"""A download is given up after this long without an answer [s]."""
_ANSWER_S = 5.0
_RETRY_S = 0.5


def fetch_blob(bus: Bus, sha256: str) -> bytes:
    """All bytes of a blob, at most `MESSAGE_BYTES_MAX`: it holds a message.

    Raises:
        RunError: If no participant has it, it is larger, or what came does not match its hash.
    """
    data = bytearray()
    while True:
        reply = bus.request(topics.BLOB, BlobRequest(sha256=sha256, offset=len(data)), timeout_s=20.0)
        if reply.size < 0:
            raise RunError(f"Blob {sha256} is not known to the run.")
        data += reply.data
        if max(reply.size, len(data)) > MESSAGE_BYTES_MAX:
            raise RunError(f"Blob {sha256} has {reply.size} bytes, more than the {MESSAGE_BYTES_MAX} of any message.")
        if len(data) >= reply.size or not reply.data:
            break
    if hashlib.sha256(data).hexdigest() != sha256:
        raise RunError(f"Blob {sha256} arrived damaged.")
    return bytes(data)


def fetch_file(bus: Bus, file: FileRef, path: Path) -> None:
    """Have a file of the run on this machine, where it is a cache for all its processes.

    It has its name only after its bytes were found to match its hash. Processes that want it at the same time wait for
    the first of them; an interrupted download resumes where it was, also in another process.

    Args:
        bus: Where it is asked for.
        file: What it must be.
        path: Where it shall be.

    Raises:
        RunError: If no participant has it, or what came does not match its hash, twice.
        BusError: If no participant answers for `ABSENT_S`.
    """
    if is_whole(path, file):
        return
    part = path.with_name(f".{path.name}.part")
    with held(path.with_name(f".{path.name}.lock"), patience_s=math.inf):
        for _ in range(2):
            if is_whole(path, file):
                return
            _download(bus, file, part)
            if is_whole(part, file):
                part.replace(path)
            else:
                # What an earlier download left may be what is wrong.
                log.warning("%s arrived damaged: it is fetched again", file.path)
                part.unlink()
        if not is_whole(path, file):
            raise RunError(f"File {file.path} of the run does not match its hash: it has changed where the run began.")


def is_whole(path: Path, file: FileRef) -> bool:
    """True if a file is what its hash says."""
    try:
        if path.stat().st_size != file.size:
            return False
        with open_regular(path) as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() == file.sha256
    except (OSError, ValueError):
        return False


def _download(bus: Bus, file: FileRef, part: Path) -> None:
    """Append to a part of a file until it is as long as the file."""
    with part.open("ab") as stream:
        if stream.tell() > file.size:
            stream.truncate(0)
        while (offset := stream.seek(0, 2)) < file.size:
            reply = _chunk(bus, file, offset)
            if reply.size != file.size or not 0 < len(reply.data) <= file.size - offset:
                raise RunError(f"File {file.path} of the run is gone, or has changed, where the run began.")
            stream.write(reply.data)
            stream.flush()


def _chunk(bus: Bus, file: FileRef, offset: int) -> BlobReply:
    """Bytes of a file from `offset` on, as soon as a participant answers."""
    deadline_s = time.monotonic() + ABSENT_S
    while True:
        try:
            return bus.request(topics.BLOB, BlobRequest(sha256=file.sha256, offset=offset), timeout_s=_ANSWER_S)
        except BusError as error:
            if isinstance(error, PeerError) or time.monotonic() > deadline_s:
                raise
            log.warning("%s Trying again.", error)
            time.sleep(_RETRY_S)
