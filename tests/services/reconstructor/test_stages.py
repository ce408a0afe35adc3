import errno
from pathlib import Path

import pytest

from readygo.common.errors import ReadygoError, RunError
from readygo.services.reconstructor.stages import Stages, code_digest


def test_finished_stages_are_not_done_again_until_something_before_them_changes(tmp_path: Path) -> None:
    made: list[str] = []

    def make(folder: Path) -> dict[str, int]:
        made.append("x")
        (folder / "file").write_text("content")
        return {"count": len(made)}

    def both(step: float) -> list[int]:
        stages = Stages(tmp_path, lambda stage: None)
        return [stages.run(name, {"step": step if name == "a" else 0}, make)["count"] for name in ("a", "b")]

    assert both(0.1) == [1, 2]
    assert both(0.1) == [1, 2]
    assert both(0.2) == [3, 4]
    assert (tmp_path / "b" / "file").read_text() == "content"


def test_what_other_code_made_is_made_again(tmp_path: Path) -> None:
    def run(code: str) -> list[str]:
        said: list[str] = []
        stages = Stages(tmp_path, lambda progress: said.append(progress.stage))
        stages.run("a", {}, lambda folder: {}, code=code)
        stages.run("b", {}, lambda folder: {})
        return said

    assert run("old") == ["a", "b"]
    assert run("old") == []
    assert run("new") == ["a", "b"]
    assert code_digest("frames") != code_digest("poses")


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, ValueError])
def test_interrupted_stage_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    def make(folder: Path) -> dict[str, int]:
        (folder / "half").write_text("x")
        raise error

    with pytest.raises((error, Exception)):
        Stages(tmp_path, lambda stage: None).run("a", {}, make)
    assert not list(tmp_path.iterdir()) or {path.name for path in tmp_path.iterdir()} == {".lock"}


def test_stage_that_goes_on_finds_what_it_left(tmp_path: Path) -> None:
    def make(folder: Path) -> dict[str, bool]:
        if not (folder / "half").exists():
            (folder / "half").write_text("x")
            raise KeyboardInterrupt
        return {"went on": True}

    with pytest.raises(KeyboardInterrupt):
        Stages(tmp_path, lambda stage: None).run("a", {}, make, keep=True)
    assert Stages(tmp_path, lambda stage: None).run("a", {}, make, keep=True) == {"went on": True}


def test_stage_that_was_begun_with_other_settings_begins_anew(tmp_path: Path) -> None:
    def stop(folder: Path) -> dict[str, bool]:
        (folder / "half").write_text("x")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Stages(tmp_path, lambda stage: None).run("a", {"step": 1}, stop, keep=True)
    found = Stages(tmp_path, lambda stage: None).run(
        "a", {"step": 2}, lambda folder: {"half": (folder / "half").exists()}, keep=True
    )
    assert found == {"half": False}


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), r"Memory ran out:.*run the same command again"),
        (RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory"), "Memory ran out"),
        (OSError(errno.ENOSPC, "No space left on device"), r"disk .* is full.*Make room and run the same"),
    ],
)
def test_what_runs_out_in_a_stage_is_told_in_one_line(tmp_path: Path, error: Exception, words: str) -> None:
    def make(folder: Path) -> dict[str, int]:
        (folder / "half").write_text("x")
        raise error

    with pytest.raises(ReadygoError, match=words):
        Stages(tmp_path, lambda stage: None).run("a", {}, make)
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (RuntimeError("No registered database factory"), r"is full \(No registered database factory\)\. Make room"),
        (RunError("It died. Make room."), r"is full\. Make room"),
    ],
)
def test_whatever_fails_on_a_full_disk_fails_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    def make(folder: Path) -> dict[str, int]:
        raise error

    monkeypatch.setattr("readygo.services.reconstructor.stages._FULL_BYTES", 1 << 62)
    with pytest.raises(RunError, match=words):
        Stages(tmp_path, lambda stage: None).run("a", {}, make)


def test_stage_does_not_begin_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.services.reconstructor.stages.ROOM_MIN_BYTES", 1 << 62)
    with pytest.raises(RunError, match=r"left on the disk.*run the same command again"):
        Stages(tmp_path, lambda stage: None).run("a", {}, lambda folder: {})
    assert not (tmp_path / "a").exists()


def test_two_commands_in_one_folder_are_refused(tmp_path: Path) -> None:
    with Stages(tmp_path, lambda stage: None).alone(), pytest.raises(RunError, match="another command works"):  # noqa: SIM117
        with Stages(tmp_path, lambda stage: None).alone():
            pass


def test_remains_of_a_killed_command_are_removed_and_folders_of_others_stay(tmp_path: Path) -> None:
    (tmp_path / ".matches-abc_1234" / "new").mkdir(parents=True)
    (tmp_path / ".oh-my-zsh").mkdir()
    with Stages(tmp_path, lambda stage: None).alone():
        assert not (tmp_path / ".matches-abc_1234").exists()
        assert (tmp_path / ".oh-my-zsh").is_dir()


@pytest.mark.parametrize("keep", [False, True])
def test_folder_that_no_stage_has_made_is_never_replaced(tmp_path: Path, keep: bool) -> None:
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "mine.jpg").write_text("mine")
    with pytest.raises(RunError, match=r"frames is there already, and no stage of a job; choose another folder"):
        Stages(tmp_path, lambda stage: None).run("frames", {}, lambda folder: {}, keep=keep)
    assert (tmp_path / "frames" / "mine.jpg").read_text() == "mine"
