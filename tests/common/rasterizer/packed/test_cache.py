"""One process makes a cache folder while others wait; what cannot be saved is not made twice."""

import errno
from pathlib import Path

from readygo.common.rasterizer.packed.cache import is_being_made, load_or_make, one_at_a_time


def load(folder: Path) -> str | None:
    """What a folder of these tests holds."""
    return (folder / "text").read_text() if folder.is_dir() else None


def save(made: str, folder: Path) -> None:
    folder.mkdir()
    (folder / "text").write_text(made)


def unwanted() -> str:
    raise AssertionError("it was made")


def test_what_was_made_is_loaded_the_next_time(tmp_path: Path) -> None:
    folder = tmp_path / "cache" / "one"
    assert load_or_make(folder, lambda: load(folder), lambda: "made", save) == "made"
    assert load_or_make(folder, lambda: load(folder), unwanted, save) == "made"


def test_who_comes_second_finds_with_the_lock_what_the_first_one_made(tmp_path: Path) -> None:
    answers = iter([None, "of the first one"])
    assert load_or_make(tmp_path / "one", lambda: next(answers), unwanted, save) == "of the first one"


def test_what_cannot_be_saved_is_returned_and_not_made_again(tmp_path: Path) -> None:
    made = []

    def make() -> str:
        made.append("made")
        return made[-1]

    def fill_the_disk(made: str, folder: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    assert load_or_make(tmp_path / "one", lambda: None, make, fill_the_disk) == "made"
    assert made == ["made"]


def test_folder_that_cannot_be_locked_is_made_by_every_process(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with one_at_a_time(tmp_path / "file" / "one"):
        assert not is_being_made(tmp_path / "file" / "one")


def test_folder_is_being_made_while_its_lock_is_held(tmp_path: Path) -> None:
    folder = tmp_path / "cache" / "avatar-0"
    assert not is_being_made(folder)
    with one_at_a_time(folder):
        assert is_being_made(folder)
        assert not is_being_made(tmp_path / "cache" / "avatar-1")
    assert not is_being_made(folder)
