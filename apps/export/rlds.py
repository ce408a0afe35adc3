"""RLDS: TFRecord files of episodes, which TensorFlow Datasets reads with `tfds.builder_from_directory(OUT)`.

    readygo-train.tfrecord-00000-of-00002    an episode per record: its steps, each list over all of them
    features.json, dataset_info.json         what is in a record; which files are which split

Layout: https://www.tensorflow.org/datasets/external_tfrecord and https://github.com/google-research/rlds; names of
the steps' parts as in Open X-Embodiment.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from readygo.apps.export.common import TASK, suffix, write_json
from readygo.apps.export.source import SPLITS, ExportedEpisode, Part, Source
from readygo.apps.export.tfrecord import Value, example, record
from readygo.common.errors import DatasetError
from readygo.common.files import unfinished

NAME, VERSION = "readygo", "1.0.0"
_CLASSES = "tensorflow_datasets.core.features"
_OBSERVED = {"goal_xy_m": 2, "velocity": 2, "pose": 4}
"""Columns of an observation besides the image, and their widths."""


def write(source: Source, part: Part, out: Path) -> Mapping[str, Any]:
    """Write a file of records."""
    name = f"{NAME}-{part.split.value}.tfrecord-{part.number_in_split:05d}"
    size = 0
    with unfinished(out / f"{name}.part", raises=DatasetError) as path, path.open("wb") as file:
        for number in part.episodes:
            data = example(_episode(source.episode(number)))
            file.write(record(data))
            size += len(data)
    image = next(source.episode(part.episodes[0]).images())
    return {
        "split": part.split.value,
        "name": name,
        "episodes": len(part.episodes),
        "bytes": size,
        "image": suffix(image),
    }


def finish(source: Source, out: Path, facts: Sequence[Any]) -> None:
    """Rename the files to include their total number, and write the files that describe them."""
    splits = []
    for split in (split.value for split in SPLITS):
        of_split = [part for part in facts if part["split"] == split]
        for part in of_split:
            written, final = out / f"{part['name']}.part", out / f"{part['name']}-of-{len(of_split):05d}"
            if written.exists():
                written.replace(final)
        if of_split:
            splits.append(_split(split, of_split))
    write_json(out / "features.json", _features(source, facts[0]["image"]))
    info = {"name": NAME, "version": VERSION, "fileFormat": "tfrecord", "moduleName": NAME, "splits": splits}
    write_json(out / "dataset_info.json", {**info, "description": "Episodes of a robot among people."})


def _split(name: str, parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        "name": name,
        "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}",
        "shardLengths": [str(part["episodes"]) for part in parts],
        "numBytes": str(sum(part["bytes"] for part in parts)),
    }


def _episode(episode: ExportedEpisode) -> dict[str, Value]:
    """An episode as lists by name, in the order of the names, as TensorFlow Datasets writes them."""
    columns, count = episode.columns, len(episode)
    last = columns["is_last"]
    reward = (last & np.bool_(episode.entry.outcome.value == "success")).astype(np.float32)
    steps: dict[str, Value] = {
        **{f"observation/{name}": columns[name] for name in _OBSERVED},
        "observation/image": list(episode.images()),
        "action": columns["action"],
        "reward": reward,
        "discount": np.ones(count, np.float32),
        "is_first": np.arange(count) == 0,
        "is_last": last,
        "is_terminal": last,
        "language_instruction": [TASK.encode()] * count,
    }
    facts: dict[str, Value] = {
        name: np.array([value]) if isinstance(value, int) else [value.encode()] for name, value in episode.facts.items()
    }
    named = {f"steps/{name}": value for name, value in steps.items()}
    return dict(sorted((named | {f"episode_metadata/{name}": value for name, value in facts.items()}).items()))


def _features(source: Source, image: str) -> dict[str, Any]:
    shape = [str(size) for size in (source.dataset.height_px, source.dataset.width_px, 3)]
    encoding = {"jpg": "jpeg", "png": "png"}[image]
    picture = {"shape": {"dimensions": shape}, "dtype": "uint8", "encodingFormat": encoding}
    observation = {name: _tensor("float32", width) for name, width in _OBSERVED.items()}
    observation["image"] = {"pythonClassName": f"{_CLASSES}.image_feature.Image", "image": picture}
    steps = {
        "observation": _group(observation),
        "action": _tensor("float32", 2),
        **{name: _tensor("float32") for name in ("reward", "discount")},
        **{name: _tensor("bool") for name in ("is_first", "is_last", "is_terminal")},
        "language_instruction": _text(),
    }
    facts = source.episode(0).facts
    about = {name: _tensor("int64") if isinstance(value, int) else _text() for name, value in facts.items()}
    sequence = {"feature": _group(steps), "length": "-1"}
    every = {"pythonClassName": f"{_CLASSES}.dataset_feature.Dataset", "sequence": sequence}
    return _group({"steps": every, "episode_metadata": _group(about)})


def _group(features: Mapping[str, Any]) -> dict[str, Any]:
    return {"pythonClassName": f"{_CLASSES}.features_dict.FeaturesDict", "featuresDict": {"features": dict(features)}}


def _tensor(dtype: str, width: int | None = None) -> dict[str, Any]:
    shape = {} if width is None else {"dimensions": [str(width)]}
    tensor = {"shape": shape, "dtype": dtype, "encoding": "none"}
    return {"pythonClassName": f"{_CLASSES}.tensor_feature.Tensor", "tensor": tensor}


def _text() -> dict[str, Any]:
    return {"pythonClassName": f"{_CLASSES}.text_feature.Text", "text": {}}
