import dataclasses
import io
import math
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.__main__ import main
from readygo.apps.commands.train import _default_recipe, _progress, train
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError
from tests.common.dataset.episodes import ROBOT, provenance_with_robot, write_shard


def test_losses_are_shown_once_they_are_known() -> None:
    console = PlainConsole(file=io.StringIO(), width=200, force_terminal=True, color_system=None)
    with _progress(console, quiet=False) as show:
        show(SimpleNamespace(fraction=0.1, step=0, train_loss=math.nan, validation_loss=math.nan))
        show(SimpleNamespace(fraction=0.5, step=7, train_loss=0.25, validation_loss=math.nan))
    shown = console.file.getvalue()
    assert "step 7, loss 0.2500, ETA" in shown
    assert "nan" not in shown


def test_recipe_that_nobody_named_is_said() -> None:
    console = PlainConsole(file=io.StringIO(), width=200)
    assert _default_recipe(SimpleNamespace(has_expert=True), console, quiet=False) == "best"
    assert _default_recipe(SimpleNamespace(has_expert=False), console, quiet=True) == "fast"
    assert console.file.getvalue() == "Recipe best: the expert was asked at every state in these data.\n"


def test_what_is_missing_is_said(tmp_path) -> None:
    with pytest.raises(ConfigError, match="No data folder"):
        train((), out=tmp_path)
    with pytest.raises(ConfigError, match="--run"):
        train((), out=tmp_path, live="tcp/127.0.0.1:1")


def _run(command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> tuple[object, str]:
    """Exit code and last line of a command line."""
    monkeypatch.setattr(sys, "argv", ["readygo", *command])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code, capsys.readouterr().err.splitlines()[-1]


def _sizes(folder: Path) -> None:
    write_shard(folder, [9], number=1, height_px=16, width_px=20)


def _limits(folder: Path) -> None:
    write_shard(folder, [9], number=1, provenance=provenance_with_robot(v_max_mps=0.7))


def _cameras(folder: Path) -> None:
    camera = dataclasses.replace(ROBOT.camera, horizontal_fov_deg=80.0)
    write_shard(folder, [9], number=1, provenance=provenance_with_robot(camera=camera))


def _empty(folder: Path) -> None:
    (folder / "shard-r0-00001.mcap").write_bytes(b"")


def _half_written(folder: Path) -> None:
    whole = folder / "shard-r0-00000.mcap"
    (folder / "shard-r0-00001.mcap").write_bytes(whole.read_bytes()[:-2000])


def _unfinished(folder: Path) -> None:
    (folder / "shard-r0-00000.mcap").rename(folder / "shard-r0-00000.mcap.part")


def _nothing(folder: Path) -> None:
    shutil.rmtree(folder)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_sizes, "Image sizes differ: 24x32 in .*, 16x20 in "),
        (_limits, r"Robots differ: v_max_mps 1\.0 and 0\.7 in "),
        (_cameras, r"Robots differ: camera\.horizontal_fov_deg 100\.0 and 80\.0 in "),
        (_empty, r"shard-r0-00001\.mcap cannot be read"),
        (_half_written, r"shard-r0-00001\.mcap is truncated"),
        (_unfinished, "holds no finished shards .*; 1 are still being written"),
        (_nothing, "does not exist"),
    ],
)
def test_data_that_cannot_be_used_are_one_line_and_leave_nothing(
    spoil: Callable[[Path], None], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    write_shard(tmp_path / "data", [0, 1, 2])
    spoil(tmp_path / "data")
    out = tmp_path / "policy"
    code, line = _run(["train", str(tmp_path / "data"), "--out", str(out)], monkeypatch, capsys)
    assert code == 2
    assert re.search(rf"^readygo: .*({words})", line)
    assert not out.exists()


def test_recipe_of_another_architecture_does_not_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    write_shard(tmp_path / "data", [0, 1, 2])
    options = ["train", str(tmp_path / "data"), "--out", str(tmp_path / "policy"), "--batch-size", "32"]
    monkeypatch.setattr(sys, "argv", ["readygo", *options, "--samples", "32", "--recipe", "fast", "--threads", "1"])
    main()
    before = (tmp_path / "policy" / "checkpoint.pt").read_bytes()
    code, line = _run([*options, "--samples", "64", "--recipe", "best", "--threads", "1"], monkeypatch, capsys)
    assert code == 2
    assert re.search(r"checkpoint\.pt belongs to a run with another \w+; give another --out, or delete it\.$", line)
    assert (tmp_path / "policy" / "checkpoint.pt").read_bytes() == before
