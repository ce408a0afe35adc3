from pathlib import Path

import pytest

from readygo.apps.demo.demo import _clear
from readygo.common.errors import RunError


def test_demo_refuses_a_folder_that_no_demo_has_made(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "shard-rec0-00000.mcap").write_text("precious")
    with pytest.raises(RunError, match="holds files of something else"):
        _clear(tmp_path)
    assert (tmp_path / "data" / "shard-rec0-00000.mcap").read_text() == "precious"


def test_demo_replaces_an_earlier_demo(tmp_path: Path) -> None:
    _clear(tmp_path / "demo")
    (tmp_path / "demo" / "run").mkdir()
    _clear(tmp_path / "demo")
    assert not (tmp_path / "demo" / "run").exists()
