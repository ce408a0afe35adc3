from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.services.reconstructor.stages import Stages


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


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, ValueError])
def test_interrupted_stage_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    def make(folder: Path) -> dict[str, int]:
        (folder / "half").write_text("x")
        raise error

    with pytest.raises((error, Exception)):
        Stages(tmp_path, lambda stage: None).run("a", {}, make)
    assert not list(tmp_path.iterdir()) or {path.name for path in tmp_path.iterdir()} == {".lock"}


def test_two_commands_in_one_folder_are_refused(tmp_path: Path) -> None:
    with Stages(tmp_path, lambda stage: None).alone(), pytest.raises(RunError, match="another command works"):  # noqa: SIM117
        with Stages(tmp_path, lambda stage: None).alone():
            pass


def test_remains_of_a_killed_command_are_removed(tmp_path: Path) -> None:
    (tmp_path / ".matches-abc").mkdir()
    with Stages(tmp_path, lambda stage: None).alone():
        assert not (tmp_path / ".matches-abc").exists()
