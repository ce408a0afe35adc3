import functools
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from readygo.apps.export import rlds
from readygo.apps.export.common import TASK
from readygo.apps.export.source import Source
from readygo.common.messages.plan import Outcome
from tests.crooked import ODD_RATES, crooked_episode, write_crooked_shard


@functools.cache
def example_class() -> Any:
    """The message of TensorFlow's example.proto, from its published field numbers.

    Kept: protobuf crashes when a message outlives the pool of its class.
    """
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


@pytest.mark.parametrize("outcome", list(Outcome))
def test_success_alone_is_rewarded_and_at_its_last_step(tmp_path: Path, outcome: Outcome) -> None:
    write_crooked_shard(tmp_path / "data", (3,), 7, robot=ODD_RATES, outcome=outcome)
    source = Source([tmp_path / "data"])
    (part,) = source.parts(10**9)
    rlds.write(source, part, tmp_path)
    (data,) = records(next(tmp_path.glob("*.part")))
    read = example_class().FromString(data).features.feature
    # 15 images a second of 30 steps: every second step is a row.
    reward = 1.0 if outcome is Outcome.SUCCESS else 0.0
    assert list(read["steps/reward"].FloatList.value) == [0.0, 0.0, 0.0, reward]
    assert list(read["steps/discount"].FloatList.value) == [1.0] * 4
    assert list(read["steps/is_first"].Int64List.value) == [1, 0, 0, 0]
    assert list(read["steps/is_last"].Int64List.value) == [0, 0, 0, 1]
    assert list(read["steps/language_instruction"].BytesList.value) == [TASK.encode()] * 4
    assert list(read["episode_metadata/outcome"].BytesList.value) == [outcome.value.encode()]
    assert list(read["episode_metadata/driver"].BytesList.value) == [b"policy"]
    _, samples = crooked_episode(3, 7, robot=ODD_RATES)
    for name, values in (
        ("goal_xy_m", [sample.goal_xy_robot_m for sample in samples[::2]]),
        ("pose", [sample.robot_xyzyaw for sample in samples[::2]]),
    ):
        stored = np.array(read[f"steps/observation/{name}"].FloatList.value).reshape(4, -1)
        np.testing.assert_allclose(stored, values, atol=1e-6)
    actions = np.array([(sample.action_v_mps, sample.action_w_radps) for sample in samples])
    means = [actions[0:2].mean(axis=0), actions[2:4].mean(axis=0), actions[4:6].mean(axis=0), actions[6]]
    stored = np.array(read["steps/action"].FloatList.value).reshape(4, 2)
    np.testing.assert_allclose(stored, means, atol=1e-6)
    stored = np.array(read["steps/observation/velocity"].FloatList.value).reshape(4, 2)
    np.testing.assert_allclose(stored, [(0.0, 0.0), *means[:-1]], atol=1e-6)


def test_facts_of_a_part_count_its_episodes_and_bytes(tmp_path: Path) -> None:
    write_crooked_shard(tmp_path / "data", (3, 8), 6)
    source = Source([tmp_path / "data"])
    (part,) = source.parts(10**9)
    facts = rlds.write(source, part, tmp_path)
    sizes = [len(data) for data in records(tmp_path / f"{facts['name']}.part")]
    assert (facts["episodes"], facts["bytes"], facts["image"]) == (2, sum(sizes), "jpg")
    rlds.finish(source, tmp_path, [facts])
    (split,) = json.loads((tmp_path / "dataset_info.json").read_text())["splits"]
    assert (split["name"], split["shardLengths"], split["numBytes"]) == ("train", ["2"], str(sum(sizes)))
    features = json.loads((tmp_path / "features.json").read_text())["featuresDict"]["features"]
    steps = features["steps"]["sequence"]["feature"]["featuresDict"]["features"]
    image = steps["observation"]["featuresDict"]["features"]["image"]["image"]
    assert image == {"shape": {"dimensions": ["22", "34", "3"]}, "dtype": "uint8", "encodingFormat": "jpeg"}


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
