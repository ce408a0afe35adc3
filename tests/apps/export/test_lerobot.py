import json
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.export import lerobot
from readygo.apps.export.common import TASK
from readygo.apps.export.source import Source

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow (extra export) is not installed")


@pytest.fixture
def out(source: Source, tmp_path: Path) -> Path:
    lerobot.finish(source, tmp_path, [lerobot.write(source, part, tmp_path) for part in source.parts(1)])
    return tmp_path


def test_info_leads_to_every_row(out: Path, source: Source) -> None:
    info = json.loads((out / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_frames"]) == ("v3.0", 20, 37)
    assert info["splits"] == {"train": "0:2", "val": "2:3"}
    episodes = [pq.read_table(path).to_pylist() for path in sorted((out / "meta" / "episodes").glob("*/*.parquet"))]
    for about in (row for rows in episodes for row in rows):
        place = {"chunk_index": about["data/chunk_index"], "file_index": about["data/file_index"]}
        rows = pq.read_table(out / info["data_path"].format(**place))
        assert set(rows.column_names) == set(info["features"])
        assert rows.column("index").to_pylist() == list(range(about["dataset_from_index"], about["dataset_to_index"]))
        np.testing.assert_allclose(rows.column("timestamp").to_numpy(), np.arange(len(rows)) / 20, atol=1e-4)
        assert rows.column("next.done").to_pylist() == [False] * (about["length"] - 1) + [True]
        first = int(source.episode(about["episode_index"]).samples[0])
        assert rows.column(lerobot.IMAGE)[0].as_py()["bytes"] == source.dataset.image(first)


def test_pandas_finds_the_task_as_the_name_of_its_row(out: Path) -> None:
    table = pq.read_table(out / "meta" / "tasks.parquet")
    assert table.column("task").to_pylist() == [TASK]
    assert json.loads(table.schema.metadata[b"pandas"])["index_columns"] == ["task"]


def test_statistics_cover_all_features(out: Path) -> None:
    info, stats = (json.loads((out / "meta" / name).read_text()) for name in ("info.json", "stats.json"))
    assert set(stats) == set(info["features"])
    assert stats["action"]["count"] == [37]
    assert stats["index"]["max"] == [36.0]
