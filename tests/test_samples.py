import json
import shutil
from pathlib import Path

import pytest

import readygo
from readygo.common.dataset import Dataset
from readygo.common.dataset.index import index_path
from tests.samples import CONTENT, FOLDER, content_of

VERSIONS = sorted(folder.name for folder in FOLDER.iterdir())


def test_this_version_has_samples() -> None:
    assert readygo.__version__ in VERSIONS, "python -m tests.samples writes them"


@pytest.mark.parametrize("version", VERSIONS)
def test_files_of_a_version_hold_what_they_held_when_they_were_written(version: str, tmp_path: Path) -> None:
    folder = shutil.copytree(FOLDER / version, tmp_path / version)
    assert content_of(folder) == json.loads((folder / CONTENT).read_text())


@pytest.mark.parametrize("version", VERSIONS)
def test_shard_of_a_version_opens_without_its_index(version: str, tmp_path: Path) -> None:
    data = shutil.copytree(FOLDER / version / "data", tmp_path / "data")
    content_hash = Dataset(data).content_hash
    index_path(next(data.glob("*.mcap"))).unlink()
    assert Dataset(data).content_hash == content_hash
