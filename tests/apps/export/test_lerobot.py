import json
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.export import lerobot
from readygo.apps.export.common import TASK
from readygo.apps.export.source import ExportSource

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow (extra export) is not installed")


@pytest.fixture
def out(source: ExportSource, tmp_path: Path) -> Path:
    lerobot.finish(source, tmp_path, [lerobot.write(source, part, tmp_path) for part in source.parts(1)])
    return tmp_path


def test_info_leads_to_every_row(out: Path, source: ExportSource) -> None:
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


def test_failures_are_done_without_success_and_rows_are_at_the_cameras_rate(
    crooked_source: ExportSource, tmp_path: Path
) -> None:
    (part,) = crooked_source.parts(10**9)
    lerobot.finish(crooked_source, tmp_path, [lerobot.write(crooked_source, part, tmp_path)])
    rows = pq.read_table(tmp_path / "data" / "chunk-000" / "file-000.parquet").to_pydict()
    assert rows["next.success"] == [False] * 15
    assert [row for row, done in enumerate(rows["next.done"]) if done] == [5, 14]
    assert rows["episode_index"] == [0] * 6 + [1] * 9
    assert rows["frame_index"] == [*range(6), *range(9)]
    assert rows["index"] == list(range(15))
    assert rows["task_index"] == [0] * 15
    np.testing.assert_allclose(rows["timestamp"], [*np.arange(6) / 15, *np.arange(9) / 15], atol=1e-6)
    columns = [crooked_source.episode(number).columns for number in range(2)]
    goals = np.concatenate([of["goal_xy_m"] for of in columns])
    velocities = np.concatenate([of["velocity"] for of in columns])
    np.testing.assert_array_equal(np.array(rows["observation.state"], np.float32), np.hstack([goals, velocities]))
    labels = np.concatenate([of["expert_action"] for of in columns])
    np.testing.assert_array_equal(np.array(rows["expert_action"], np.float32), labels)
    info = json.loads((tmp_path / "meta" / "info.json").read_text())
    assert info["features"]["expert_action"] == {"dtype": "float32", "shape": [2], "names": ["v_mps", "w_radps"]}
    assert (info["fps"], info["total_episodes"], info["total_frames"]) == (15, 2, 15)
    assert info["splits"] == {"train": "0:2"}
    assert info["features"][lerobot.IMAGE]["shape"] == [22, 34, 3]
    assert info["features"]["observation.state"]["shape"] == [4]
    assert info["features"]["next.done"]["shape"] == [1]
    (about, other) = pq.read_table(tmp_path / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    assert (about["length"], about["dataset_from_index"], about["dataset_to_index"]) == (6, 0, 6)
    assert (other["length"], other["dataset_from_index"], other["dataset_to_index"]) == (9, 6, 15)
    assert (about["outcome"], other["outcome"]) == ("human_collision", "timeout")
    stats = json.loads((tmp_path / "meta" / "stats.json").read_text())
    assert stats["frame_index"]["mean"] == pytest.approx([(15 + 36) / 15])


def test_success_is_at_the_last_row_alone(source: ExportSource) -> None:
    assert lerobot.numbers_of(source.episode(1))["next.success"].tolist() == [False] * 9 + [True]
