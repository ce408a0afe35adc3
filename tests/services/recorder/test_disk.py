import errno
import os
from pathlib import Path

import pytest

from readygo.common.errors import DiskError, RunError
from readygo.services.recorder.disk import disk_error, try_room


@pytest.mark.parametrize(
    ("code", "waits", "text"),
    [
        (errno.ENOSPC, True, "No space left in /data; free some, and recording continues."),
        (errno.EDQUOT, True, "No space left in /data; free some, and recording continues."),
        (errno.EROFS, True, "/data cannot be written (Read-only file system); fix that, and recording continues."),
        (errno.EACCES, True, "/data cannot be written (Permission denied); fix that, and recording continues."),
        (errno.EPERM, True, "/data cannot be written (Operation not permitted); fix that, and recording continues."),
        (errno.EIO, False, "Writing to /data failed: Input/output error; fix that and run again to resume."),
    ],
)
def test_disk_that_can_be_waited_for_is_told_from_one_that_fails(code: int, waits: bool, text: str) -> None:
    error = disk_error(Path("/data"), OSError(code, os.strerror(code)))
    assert (isinstance(error, DiskError), str(error)) == (waits, text)


def test_room_is_tried_without_a_trace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[tuple[str, int]] = []
    write = Path.write_bytes
    monkeypatch.setattr(
        "pathlib.Path.write_bytes", lambda path, data: written.append((path.name, len(data))) or write(path, data)
    )
    try_room(tmp_path, "r0")
    assert written == [(".room-r0", 2**20)]
    assert list(tmp_path.iterdir()) == []

    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", refuse)
    with pytest.raises(RunError, match="No space left in"):
        try_room(tmp_path, "r0")
    assert list(tmp_path.iterdir()) == []
