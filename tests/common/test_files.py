import os
import shutil
import threading
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import ReadygoError, SceneError
from readygo.common.files import (
    cache_root,
    check_folder_name,
    disk_space,
    make_cache_folder,
    open_regular,
    open_zip,
    read_regular,
    remove_unfinished,
    unfinished_folder,
    write_then_rename,
    write_whole,
)


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
    with pytest.raises(ZeroDivisionError), write_then_rename(path) as part:  # noqa: PT012
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


def test_folder_appears_only_when_the_block_ends_well(tmp_path: Path) -> None:
    with unfinished_folder(tmp_path / "a" / "pack") as part:
        (part / "one").write_text("1")
        assert not (tmp_path / "a" / "pack").exists()
    assert (tmp_path / "a" / "pack" / "one").read_text() == "1"
    with pytest.raises(ZeroDivisionError), unfinished_folder(tmp_path / "b"):
        raise ZeroDivisionError
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "one", "pack"]


def test_folder_that_is_there_is_replaced_only_where_it_is_not_good(tmp_path: Path) -> None:
    def write(text: str, good: Callable[[], object] | None) -> str:
        with unfinished_folder(tmp_path / "pack", good=good) as part:
            (part / "text").write_text(text)
        return (tmp_path / "pack" / "text").read_text()

    assert write("first", None) == "first"
    with pytest.raises(ReadygoError, match="pack cannot be written: it is there already"):
        write("second", None)
    assert write("third", lambda: True) == "first"
    assert write("fourth", lambda: False) == "fourth"
    assert [entry.name for entry in tmp_path.iterdir()] == ["pack"]


def test_processes_that_replace_the_same_folder_do_not_meet(tmp_path: Path) -> None:
    folder = tmp_path / "pack"

    def write(number: int) -> None:
        for _ in range(20):
            with unfinished_folder(folder, good=lambda: False) as part:
                for name in ("a", "b"):
                    (part / name).write_text(str(number))

    with ThreadPoolExecutor() as pool:
        for done in [pool.submit(write, number) for number in range(4)]:
            done.result()
    assert (folder / "a").read_text() == (folder / "b").read_text()
    assert [entry.name for entry in tmp_path.iterdir()] == ["pack"]


def test_mapped_files_of_a_replaced_folder_stay_as_they_were(tmp_path: Path) -> None:
    for number in range(2):
        with unfinished_folder(tmp_path / "pack", good=lambda: False) as part:
            np.save(part / "numbers.npy", np.full(1000, number))
        if number == 0:
            mapped = np.load(tmp_path / "pack" / "numbers.npy", mmap_mode="r")
    assert (mapped == 0).all()
    assert (np.load(tmp_path / "pack" / "numbers.npy") == 1).all()


def test_folder_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    for raises in (SceneError, OSError):
        with (
            pytest.raises(raises, match=r"file/pack cannot be written: .+"),
            unfinished_folder(tmp_path / "file" / "pack", raises=raises),
        ):
            pass


def test_regular_files_are_read_and_nothing_else_is_waited_for(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"some bytes")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    assert read_regular(tmp_path / "a") == read_regular(tmp_path / "a", bytes_max=10) == b"some bytes"
    with open_regular(tmp_path / "a") as stream:
        assert stream.read() == b"some bytes"
    for name in ("pipe", "link", "/dev/zero", "/dev/null"):
        with pytest.raises(OSError, match="it is a pipe or a device, no regular file"):
            read_regular(tmp_path / name)
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "absent")
    with pytest.raises(OSError, match="no file can have this name"):
        open_regular("a\0b")
    with pytest.raises(OSError, match="it has 10 bytes, more than the 9 that are read"):
        read_regular(tmp_path / "a", bytes_max=9)


def test_archive_is_opened_and_its_entries_read(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("large", bytes(3 * 2**20))
    with open_zip(tmp_path / "a.zip") as archive:
        assert archive.read("large") == bytes(3 * 2**20)
    (tmp_path / "b.zip").write_bytes(b"no archive")
    with pytest.raises(zipfile.BadZipFile), open_zip(tmp_path / "b.zip"):
        pass


def test_room_of_a_disk_is_what_is_free_and_all_and_nothing_where_there_is_none(tmp_path: Path) -> None:
    usage = shutil.disk_usage(tmp_path)
    free, size = disk_space(tmp_path)
    assert size == usage.total
    assert free == pytest.approx(usage.free, rel=0.2)
    assert free < size
    assert disk_space(tmp_path / "none") == (0, 0)


def test_cache_is_where_the_environment_says_else_at_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_root() == tmp_path / "readygo"
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert cache_root() == Path.home() / ".cache" / "readygo"


def test_cache_folder_that_is_read_only_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert make_cache_folder(tmp_path / "a" / "b").is_dir()
    monkeypatch.setattr(os, "access", lambda path, how: how != os.W_OK)
    with pytest.raises(ReadygoError, match=r"a/b cannot be used \(it is read-only\); set XDG_CACHE_HOME"):
        make_cache_folder(tmp_path / "a" / "b")


def test_folder_that_cannot_be_moved_for_another_reason_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, target: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "rename", refuse)
    with (
        pytest.raises(ReadygoError, match="pack cannot be written: Permission denied"),
        unfinished_folder(tmp_path / "pack", good=lambda: pytest.fail("it is not there")),
    ):
        pass


def test_folder_is_replaced_again_and_again_until_it_is_good(tmp_path: Path) -> None:
    asked: list[str] = []

    def good() -> bool:
        asked.append((tmp_path / "pack" / "text").read_text())
        return False

    with unfinished_folder(tmp_path / "pack") as part:
        (part / "text").write_text("old")
    with unfinished_folder(tmp_path / "pack", good=good) as part:
        (part / "text").write_text("new")
    assert asked == ["old"]
    assert (tmp_path / "pack" / "text").read_text() == "new"


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "a b", "-a", "a\n", "a\\b"])
def test_names_that_no_folder_should_have(name: str) -> None:
    with pytest.raises(ValueError, match="is no name of letters"):
        check_folder_name(name)


@pytest.mark.parametrize("name", ["a", "embedded-1", "lobby_2.v1", "a+b", "été"])
def test_names_of_folders(name: str) -> None:
    check_folder_name(name)


def test_what_killed_writers_leave_is_removed(tmp_path: Path) -> None:
    left = tmp_path / "left"
    for write, name in ((unfinished_folder, "frames"), (unfinished_folder, "v2.frames"), (write_then_rename, "a.mp4")):
        with write(tmp_path / name) as part:
            (part / "file" if part.is_dir() else part).touch()
            shutil.copytree(part.parent, left / part.parent.name)
    shutil.copytree(next(left.iterdir()), left / ".old-abcdefg1" / "old")
    assert len(list(left.iterdir())) == 4
    remove_unfinished(left)
    assert not list(left.iterdir())


def test_hidden_folders_of_others_stay(tmp_path: Path) -> None:
    kept = [".oh-my-zsh/new/x", ".venv-3.12/part", ".conf-12345678/settings", ".conf-abcdefgh/new/x", "a-12345678/new"]
    for name in (*kept, ".conf-abcdefgh/other"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / ".file-abcdefgh").touch()
    remove_unfinished(tmp_path)
    assert all((tmp_path / name).is_file() for name in (*kept, ".file-abcdefgh"))
