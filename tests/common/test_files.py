import threading
from pathlib import Path

import pytest

from readygo.common.errors import ReadygoError, SceneError
from readygo.common.files import unfinished, write_whole


def test_processes_that_write_the_same_file_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    contents = [bytes([number]) * 2_000_000 for number in range(4)]
    threads = [
        threading.Thread(target=lambda data=data: [write_whole(path, data) for _ in range(5)]) for data in contents
    ]
    failures: list[object] = []
    threading.excepthook, before = failures.append, threading.excepthook
    try:
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads):
            if path.exists():
                assert path.read_bytes() in contents
        for thread in threads:
            thread.join()
    finally:
        threading.excepthook = before
    assert failures == []
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene.ply"]


def test_folders_on_the_way_are_made_and_text_is_utf8(tmp_path: Path) -> None:
    write_whole(tmp_path / "a" / "b" / "note.txt", "5 \u00b0C")
    assert (tmp_path / "a" / "b" / "note.txt").read_bytes() == b"5 \xc2\xb0C"


def test_a_block_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    write_whole(path, b"old")
    with pytest.raises(ZeroDivisionError), unfinished(path) as part:  # noqa: PT012
        assert part.suffix == ".yaml"
        part.write_bytes(b"half")
        raise ZeroDivisionError
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["map.yaml"]


@pytest.mark.parametrize("raises", [ReadygoError, SceneError])
def test_what_cannot_be_written_is_one_clear_line(tmp_path: Path, raises: type[ReadygoError]) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(raises, match=r"file/scene\.ply cannot be written: .+"):
        write_whole(tmp_path / "file" / "scene.ply", b"data", raises=raises)
