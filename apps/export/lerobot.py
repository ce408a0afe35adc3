"""LeRobot, version 3.0 of its dataset format; images are embedded in the Parquet files as they were recorded.

    data/chunk-000/file-000.parquet             rows of several episodes
    meta/episodes/chunk-000/file-000.parquet    for each of them: its rows, files and statistics
    meta/info.json, stats.json, tasks.parquet   features, rates, splits; overall statistics; the one task

An episode's state holds the policy's inputs besides the image: the goal in the robot's frame and the command that the
robot executes. Layout: https://huggingface.co/docs/lerobot/lerobot-dataset-v3 and `lerobot/datasets/utils.py`.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.apps.export.arrow import Column, table_of, write_tables
from readygo.apps.export.common import TASK
from readygo.apps.export.source import SPLITS, ExportedEpisode, ExportPart, ExportSource
from readygo.apps.export.statistics import Statistics, merge_statistics, of_images, of_rows
from readygo.common.documents import write_json
from readygo.common.errors import DatasetError
from readygo.common.files import write_whole

VERSION = "v3.0"
CHUNK_FILES = 1000
"""Files per folder."""
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
IMAGE = "observation.images.front"
NAMES: Mapping[str, list[str] | None] = {
    "observation.state": ["goal_x_m", "goal_y_m", "v_mps", "w_radps"],
    "observation.pose": ["x_m", "y_m", "z_m", "yaw_rad"],
    "action": ["v_mps", "w_radps"],
    "expert_action": ["v_mps", "w_radps"],
    "next.done": None,
    "next.success": None,
    "timestamp": None,
    "frame_index": None,
    "episode_index": None,
    "index": None,
    "task_index": None,
}
"""Features besides the image, with the names of their components; expert_action where the data holds it."""


def write(source: ExportSource, part: ExportPart, out: Path) -> Mapping[str, Any]:
    """Write the rows of a part, and return the facts about its episodes."""
    chunk, number = divmod(part.number, CHUNK_FILES)
    place = FILE.format(chunk_index=chunk, file_index=number)
    about: list[dict[str, Any]] = []

    def rows_of(episode: ExportedEpisode) -> Any:
        columns = numbers_of(episode)
        about.append(_about(episode, columns, chunk, number))
        return table_of({IMAGE: list(episode.images()), **columns})

    write_tables(out / "data" / place, (rows_of(source.episode(number)) for number in part.episodes))
    write_tables(out / "meta" / "episodes" / place, [_plain_table(about)])
    features = {name: _feature(column) for name, column in numbers_of(source.episode(part.episodes[0])).items()}
    return {"features": features, "statistics": merge_statistics([_statistics_in(row) for row in about])}


def finish(source: ExportSource, out: Path, facts: Sequence[Any]) -> None:
    """Write the files in meta/, which describe the whole export."""
    import pyarrow as pa

    write_json(
        out / "meta" / "stats.json", merge_statistics([part["statistics"] for part in facts]), raises=DatasetError
    )
    # pandas reads the task as the row's index.
    types = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
    described = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": dtype, "metadata": None}
        for name, (kind, dtype) in types.items()
    ]
    names = {"index_columns": ["task"], "columns": described, "column_indexes": [], "pandas_version": "2.0.0"}
    tasks = pa.table({"task_index": pa.array([0], pa.int64()), "task": [TASK]})
    write_tables(out / "meta" / "tasks.parquet", [tasks.replace_schema_metadata({"pandas": json.dumps(names)})])
    write_json(out / "meta" / "info.json", _info(source, facts[0]["features"]), raises=DatasetError)
    card = f"---\ntags:\n- LeRobot\n---\n\n{source.episode_count} episodes of a robot among people.\n"
    write_whole(out / "README.md", card, raises=DatasetError)


def numbers_of(episode: ExportedEpisode) -> dict[str, npt.NDArray[np.generic]]:
    """The features of an episode's rows besides the image."""
    columns, count = episode.columns, len(episode)
    numbers = np.arange(count)
    done = columns["is_last"]
    return {
        "observation.state": np.hstack([columns["goal_xy_m"], columns["velocity"]]),
        "observation.pose": columns["pose"],
        **{name: columns[name] for name in ("action", "expert_action") if name in columns},
        "next.done": done,
        "next.success": done & np.bool_(episode.entry.outcome.value == "success"),
        # LeRobot requires timestamps at multiples of 1 / fps.
        "timestamp": columns["time_s"],
        "frame_index": numbers,
        "episode_index": np.full(count, episode.number),
        "index": episode.first_row + numbers,
        "task_index": np.zeros(count, np.int64),
    }


def _about(episode: ExportedEpisode, columns: Mapping[str, Any], chunk: int, number: int) -> dict[str, Any]:
    """An episode's row of meta/episodes."""
    statistics: Statistics = {IMAGE: of_images(list(episode.images()))}
    statistics |= {name: of_rows(column) for name, column in columns.items()}
    places = {
        f"{what}/{name}_index": value
        for what in ("data", "meta/episodes")
        for name, value in (("chunk", chunk), ("file", number))
    }
    return {
        "episode_index": episode.number,
        "tasks": [TASK],
        "length": len(episode),
        "dataset_from_index": episode.first_row,
        "dataset_to_index": episode.first_row + len(episode),
        **places,
        **episode.facts,
        **{f"stats/{name}/{key}": value for name, stats in statistics.items() for key, value in stats.items()},
    }


def _statistics_in(row: Mapping[str, Any]) -> Statistics:
    found: Statistics = {}
    for name, value in row.items():
        if name.startswith("stats/"):
            feature, key = name.removeprefix("stats/").rsplit("/", 1)
            found.setdefault(feature, {})[key] = value
    return found


def _plain_table(rows: Sequence[Mapping[str, Any]]) -> Any:
    import pyarrow as pa

    return pa.Table.from_pylist([dict(row) for row in rows])


def _feature(column: Column) -> dict[str, Any]:
    assert not isinstance(column, list)
    return {"dtype": str(column.dtype), "shape": [1 if column.ndim == 1 else column.shape[1]]}


def _info(source: ExportSource, features: Mapping[str, Any]) -> dict[str, Any]:
    shape = [source.dataset.height_px, source.dataset.width_px, 3]
    splits = {split.value: source.of_split(split) for split in SPLITS}
    return {
        "codebase_version": VERSION,
        "robot_type": "readygo",
        "total_episodes": source.episode_count,
        "total_frames": source.row_count,
        "total_tasks": 1,
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": source.rate_hz,
        "splits": {name: f"{numbers.start}:{numbers.stop}" for name, numbers in splits.items() if numbers},
        "data_path": f"data/{FILE}",
        "video_path": None,
        "features": {
            IMAGE: {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]},
            **{name: {**features[name], "names": names} for name, names in NAMES.items() if name in features},
        },
    }
