import dataclasses
import json

import pytest
from mcap.reader import make_reader

from readygo.common.dataset import Provenance, SceneOrigin
from readygo.common.dataset.provenance import (
    AvatarOrigin,
    ScenarioOrigin,
    TeacherOrigin,
    provenance_from_strings,
    provenance_to_strings,
)
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.messages import RunSpec, Split
from tests.common.dataset.episodes import PROVENANCE, ROBOT
from tests.samples import FOLDER


def recorded_strings() -> dict[str, str]:
    """The metadata record of the shard among the samples of the first version."""
    with next((FOLDER / "0.1.0" / "data").glob("*.mcap")).open("rb") as file:
        (record,) = make_reader(file).iter_metadata()
    return record.metadata


def test_record_keeps_its_keys_and_bytes() -> None:
    strings = recorded_strings()
    assert list(strings) == sorted(
        ["avatars", "commit", "config", "format", "numeric_class", "readygo_version", "scene", "seed"]
    )
    assert provenance_to_strings(provenance_from_strings(strings)) == strings


def test_mapping_comes_back() -> None:
    whole = dataclasses.replace(PROVENANCE, scenarios=ScenarioOrigin(name="five.toml", sha256="ef" * 32))
    taught = dataclasses.replace(whole, teacher=TeacherOrigin(sha256="cd" * 32))
    tracked = dataclasses.replace(whole, teacher=TeacherOrigin(kind="expert-tracked"))
    for provenance in (tracked, taught, whole, PROVENANCE, Provenance()):
        assert Provenance.from_mapping(json.loads(json.dumps(provenance.to_mapping()))) == provenance
    assert PROVENANCE.robot == ROBOT
    assert Provenance().robot is None


def test_what_is_not_known_is_left_out_and_what_is_missing_is_empty() -> None:
    mapping = {"scene": {"name": "plaza", "mood": "sunny"}, "avatars": {"ann": {}}, "weather": "fine"}
    provenance = Provenance.from_mapping(mapping)
    assert provenance == Provenance(scene=SceneOrigin(name="plaza"), avatars={"ann": AvatarOrigin()})


@pytest.mark.parametrize("mapping", [{"scene": "plaza"}, {"avatars": ["ann"]}, {"scenarios": 3}])
def test_values_of_another_kind_are_refused(mapping: dict[str, object]) -> None:
    with pytest.raises(DatasetError, match="metadata cannot be read"):
        Provenance.from_mapping(mapping)


def test_provenance_of_a_run_has_its_settings_and_seed() -> None:
    made = dataclasses.replace(PROVENANCE, config=None, seed=None)
    spec = RunSpec(
        run="run-0",
        scene_path="",
        scene_hash="0" * 64,
        scene_files=(),
        avatars_path="",
        avatar_hashes={},
        seed=7,
        split=Split.TRAIN,
        static=False,
        config=dict(PROVENANCE.config or {}),
        metadata=made.to_mapping(),
    )
    assert Provenance.of_run(spec) == PROVENANCE


@pytest.mark.parametrize("config", [{"renderer": 3}, {"renderer": {"sensor": {"k1": 7}}}, {"renderer": []}])
def test_settings_of_another_shape_are_refused_when_they_are_asked_for(config: dict[str, object]) -> None:
    provenance = provenance_from_strings(provenance_to_strings(dataclasses.replace(PROVENANCE, config=config)))
    with pytest.raises(ConfigError, match=r"settings are none|none of this version: k1 must be an array"):
        _ = provenance.sensor


def test_deep_metadata_is_refused() -> None:
    with pytest.raises(DatasetError, match="nest deeper"):
        provenance_from_strings({"format": "[" * 100_000})
