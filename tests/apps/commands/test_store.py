from pathlib import Path

import pytest

from readygo.apps.commands.store import StoreOptions, store
from readygo.common.errors import DatasetError
from tests.apps.fleet.toy_line import DRAW, FILM, in_process, make_folder

pytest.importorskip("fsspec", reason="the extra store is not installed")


def test_files_are_named_as_they_are_copied(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = make_folder(tmp_path / "data", (DRAW, FILM), wanted=1)
    with pytest.raises(DatasetError, match="holds no finished shards"):
        store(StoreOptions(data=folder.path, url=str(tmp_path / "bucket")))
    assert in_process(folder, (DRAW, FILM)).finished
    store(StoreOptions(data=folder.path, url=str(tmp_path / "bucket"), check=True))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "shard-rec0-00000.mcap copied"
    assert "shards.json lists what is there" in lines[-1]
