from pathlib import Path

import pytest

from readygo.apps.export import parquet
from readygo.apps.export.source import ExportSource

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow (extra export) is not installed")


def test_files_by_split_hold_all_rows(source: ExportSource, tmp_path: Path) -> None:
    parquet.finish(source, tmp_path, [parquet.write(source, part, tmp_path) for part in source.parts(10**9)])
    read = pq.read_table(tmp_path / "data" / "train-00000.parquet")
    assert read.num_rows == 31
    assert read.column("episode_id")[30].as_py() == "train-7-000002"
    assert read.column("image")[5].as_py()["bytes"] == source.dataset.image(int(source.episode(0).samples[5]))
    assert pq.read_table(tmp_path / "data" / "validation-00000.parquet").num_rows == 6
    card = (tmp_path / "README.md").read_text()
    assert "  - split: validation\n    path: data/validation-*.parquet\n" in card
