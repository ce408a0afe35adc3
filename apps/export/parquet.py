"""Hugging Face: Parquet files by split, which `datasets.load_dataset` reads as they are; images are embedded.

    data/train-00000.parquet    one row per image; columns image, action, goal_xy_m, ..., episode_id, outcome
    README.md                   which files are which split; the Hub shows it as the dataset's card

Layout: https://huggingface.co/docs/hub/datasets-manual-configuration and .../datasets-image.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from readygo.apps.export.arrow import Column, table_of, write_tables
from readygo.apps.export.source import ExportedEpisode, ExportPart, ExportSource
from readygo.common.errors import DatasetError
from readygo.common.files import write_whole
from readygo.common.messages import Split

NAMES = {Split.TRAIN: "train", Split.VAL: "validation", Split.TEST: "test"}
"""Names of the splits at Hugging Face."""


def write(source: ExportSource, part: ExportPart, out: Path) -> Mapping[str, Any]:
    """Write a Parquet file."""
    tables = (table_of(columns(source.episode(number))) for number in part.episodes)
    size = write_tables(out / _name(part), tables)
    return {"split": part.split.value, "file": _name(part), "size_bytes": size}


def finish(source: ExportSource, out: Path, facts: Sequence[Any]) -> None:
    """Write the list of the files of each split."""
    lines = ["---", "task_categories:", "- robotics", "tags:", "- navigation", "configs:", "- config_name: default"]
    lines += ["  data_files:"]
    for split in dict.fromkeys(part["split"] for part in facts):
        lines += [f"  - split: {NAMES[Split(split)]}", f"    path: data/{NAMES[Split(split)]}-*.parquet"]
    lines += ["---", "", f"# {source.episode_count} episodes of a robot among people", ""]
    lines += [f"{source.row_count} rows at {source.rate_hz} Hz, written by `readygo export`.", ""]
    write_whole(out / "README.md", "\n".join(lines), raises=DatasetError)


def columns(episode: ExportedEpisode) -> dict[str, Column]:
    """All columns of an episode's rows."""
    count = len(episode)
    pictures = {"image" if output == "rgb" else output: output for output in episode.dataset.outputs}
    constant: Iterator[tuple[str, Column]] = (
        (name, np.full(count, value) if isinstance(value, int) else [value] * count)
        for name, value in episode.facts.items()
    )
    return {
        **{name: list(episode.images(output)) for name, output in pictures.items()},
        "row": np.arange(count),
        **episode.columns,
        **dict(constant),
    }


def _name(part: ExportPart) -> str:
    return f"data/{NAMES[part.split]}-{part.number_in_split:05d}.parquet"
