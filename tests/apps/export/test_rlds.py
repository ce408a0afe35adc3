import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from readygo.apps.export import rlds
from readygo.apps.export.source import Source


def example_class() -> Any:
    """The message of TensorFlow's example.proto, from its published field numbers."""
    field = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="example.proto", package="published", syntax="proto3")
    kinds = {"BytesList": field.TYPE_BYTES, "FloatList": field.TYPE_FLOAT, "Int64List": field.TYPE_INT64}

    def add(message: Any, name: str, number: int, kind: Any, type_name: str = "", repeated: bool = False) -> None:
        label = field.LABEL_REPEATED if repeated else field.LABEL_OPTIONAL
        message.field.add(name=name, number=number, type=kind, label=label)
        if type_name:
            message.field[-1].type_name = type_name

    for name, kind in kinds.items():
        add(file.message_type.add(name=name), "value", 1, kind, repeated=True)
    feature = file.message_type.add(name="Feature")
    for number, name in enumerate(kinds, 1):
        add(feature, name, number, field.TYPE_MESSAGE, f".published.{name}")
    features = file.message_type.add(name="Features")
    entry = features.nested_type.add(name="FeatureEntry")
    entry.options.map_entry = True
    add(entry, "key", 1, field.TYPE_STRING)
    add(entry, "value", 2, field.TYPE_MESSAGE, ".published.Feature")
    add(features, "feature", 1, field.TYPE_MESSAGE, ".published.Features.FeatureEntry", repeated=True)
    add(file.message_type.add(name="Example"), "features", 1, field.TYPE_MESSAGE, ".published.Features")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("published.Example"))


def records(path: Path) -> Iterator[bytes]:
    data = path.read_bytes()
    while data:
        (length,) = struct.unpack("<Q", data[:8])
        yield data[12 : 12 + length]
        data = data[16 + length :]


@pytest.fixture
def out(source: Source, tmp_path: Path) -> Path:
    rlds.finish(source, tmp_path, [rlds.write(source, part, tmp_path) for part in source.parts(1)])
    return tmp_path


def test_records_are_examples_with_all_steps(out: Path, source: Source) -> None:
    files = sorted(path.name for path in out.glob("*.tfrecord*"))
    assert files == [f"readygo-train.tfrecord-0000{n}-of-00002" for n in (0, 1)] + [
        "readygo-val.tfrecord-00000-of-00001"
    ]
    (data,) = records(out / files[1])
    read = example_class().FromString(data).features.feature
    episode = source.episode(1)
    actions = np.array(read["steps/action"].FloatList.value, np.float32).reshape(-1, 2)
    np.testing.assert_array_equal(actions, episode.columns["action"])
    assert list(read["steps/observation/image"].BytesList.value) == list(episode.images())
    assert list(read["steps/is_first"].Int64List.value) == [1] + [0] * 9
    assert list(read["steps/reward"].FloatList.value) == [0.0] * 9 + [1.0]
    assert list(read["episode_metadata/episode_id"].BytesList.value) == [b"train-7-000002"]


def test_features_describe_what_the_records_hold(out: Path) -> None:
    def names(features: dict[str, Any], prefix: str = "") -> Iterator[str]:
        for name, feature in features["featuresDict"]["features"].items():
            inner = feature.get("sequence", {}).get("feature", feature)
            yield from names(inner, f"{prefix}{name}/") if "featuresDict" in inner else [prefix + name]

    (data,) = records(next(out.glob("readygo-val*")))
    described = set(names(json.loads((out / "features.json").read_text())))
    assert described == set(example_class().FromString(data).features.feature)
    info = json.loads((out / "dataset_info.json").read_text())
    assert [(split["name"], split["shardLengths"]) for split in info["splits"]] == [
        ("train", ["1", "1"]),
        ("val", ["1"]),
    ]


def test_finishing_twice_changes_nothing(out: Path, source: Source) -> None:
    before = {path: path.read_bytes() for path in out.glob("readygo-*")}
    facts = [
        {
            "split": part.split.value,
            "name": f"readygo-{part.split.value}.tfrecord-{part.number_in_split:05d}",
            "episodes": 1,
            "bytes": 1,
            "image": "jpg",
        }
        for part in source.parts(1)
    ]
    rlds.finish(source, out, facts)
    assert {path: path.read_bytes() for path in out.glob("readygo-*")} == before
