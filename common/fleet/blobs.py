"""Fetching what is too large for a reply."""

import hashlib

from readygo.common.bus import Bus
from readygo.common.errors import RunError
from readygo.common.messages import BlobRequest, topics


def fetch_blob(bus: Bus, sha256: str) -> bytes:
    """All bytes of a blob.

    Raises:
        RunError: If nobody has it, or what came does not match its hash.
    """
    data = bytearray()
    while True:
        reply = bus.request(topics.BLOB, BlobRequest(sha256=sha256, offset=len(data)), timeout_s=20.0)
        if reply.size < 0:
            raise RunError(f"Blob {sha256} is not known to the run.")
        data += reply.data
        if len(data) >= reply.size or not reply.data:
            break
    if hashlib.sha256(data).hexdigest() != sha256:
        raise RunError(f"Blob {sha256} arrived damaged.")
    return bytes(data)
