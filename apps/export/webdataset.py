"""WebDataset: tar files with a few members per row, whose names share a prefix.

    train-000000.tar    000003-train-0-000003-000017.jpg, .json, and .depth.png, .mask.png ... where they are recorded
    index.json          the tar files of every split, and how many rows each has

Layout: https://github.com/webdataset/webdataset, "The WebDataset Format".
"""

import io
import json
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Any

from readygo.apps.export.common import suffix
from readygo.apps.export.source import ExportedEpisode, ExportPart, ExportSource
from readygo.common.documents import write_json
from readygo.common.errors import DatasetError
from readygo.common.files import write_then_rename


def write(source: ExportSource, part: ExportPart, out: Path) -> Mapping[str, Any]:
    """Write a tar file."""
    name, rows = f"{part.split.value}-{part.number_in_split:06d}.tar", 0
    with write_then_rename(out / name, raises=DatasetError) as path, tarfile.open(path, "w") as tar:
        for number in part.episodes:
            episode = source.episode(number)
            rows += len(episode)
            for member, data in _members(episode):
                entry = tarfile.TarInfo(member)
                entry.size = len(data)
                tar.addfile(entry, io.BytesIO(data))
    return {"split": part.split.value, "file": name, "rows": rows}


def finish(source: ExportSource, out: Path, facts: Sequence[Any]) -> None:
    """Write the list of the tar files."""
    write_json(out / "index.json", {"rate_hz": source.rate_hz, "files": list(facts)}, raises=DatasetError)


def _members(episode: ExportedEpisode) -> Iterator[tuple[str, bytes]]:
    """Names and contents of an episode's members, row by row."""
    outputs = episode.dataset.outputs
    columns = {name: column.tolist() for name, column in episode.columns.items()}
    for row, images in enumerate(zip(*(episode.images(output) for output in outputs), strict=True)):
        key = f"{episode.name}-{row:06d}"
        for output, image in zip(outputs, images, strict=True):
            kind = suffix(image) if output == "rgb" else f"{output}.{suffix(image)}"
            yield f"{key}.{kind}", image
        values = {name: None if column[row] in (inf, -inf) else column[row] for name, column in columns.items()}
        yield f"{key}.json", json.dumps({"row": row, **episode.facts, **values}).encode()
