import dataclasses
import json
import shutil
from pathlib import Path

import pytest
from mcap.reader import make_reader

from readygo.common.dataset import AvatarOrigin, Dataset, Provenance, ScenarioOrigin, SceneOrigin, ShardWriter, validate
from readygo.common.dataset.index import index_path
from readygo.common.dataset.provenance import provenance_from_strings, provenance_to_strings
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.messages import RunSpec, Split
from tests.common.dataset.episodes import PROVENANCE, ROBOT
from tests.common.dataset.forge import chunks_of

RECORDED = Path(__file__).parents[2] / "golden" / "recorded_0.1.0"
"""A shard and its index from before provenance had a class of its own."""


def recorded_strings() -> dict[str, str]:
    """The metadata record of the shard in `RECORDED`."""
    with next(RECORDED.glob("*.mcap")).open("rb") as file:
        (record,) = make_reader(file).iter_metadata()
    return record.metadata


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    return shutil.copytree(RECORDED, tmp_path / "data")


def test_record_keeps_its_keys_and_bytes() -> None:
    strings = recorded_strings()
    assert list(strings) == sorted(
        ["avatars", "commit", "config", "format", "numeric_class", "readygo_version", "scene", "seed"]
    )
    assert provenance_to_strings(provenance_from_strings(strings)) == strings


@pytest.mark.parametrize("with_index", [True, False])
def test_shard_of_an_earlier_version_opens(recorded: Path, with_index: bool) -> None:
    if not with_index:
        index_path(next(recorded.glob("*.mcap"))).unlink()
    dataset = Dataset([recorded])
    assert dataset.content_hash == "596340fac5026584240b4b8bd9f485e79f3f83bbe24a656517aadfb53599aaba"
    provenance = dataset.provenance
    assert (provenance.readygo_version, provenance.seed, provenance.scenarios) == ("0.1.0", 0, None)
    assert provenance.scene == SceneOrigin(
        name="showroom", hash="88c761a4d3df9e986ff9d473120292f6ed3e2a167db432f6a0133c809f8ce7c9"
    )
    assert provenance.avatars["m2_suit"].license.startswith("CC0-1.0")
    assert dataset.robot is not None
    assert dataset.robot.radius_m == 0.25


def test_recorded_episodes_are_written_as_the_same_file(recorded: Path, tmp_path: Path) -> None:
    shard = next(recorded.glob("*.mcap"))
    again = tmp_path / shard.name
    with ShardWriter(again, Dataset([recorded]).provenance, outputs=chunks_of(shard)[0].outputs, fsync=False) as writer:
        for chunk in chunks_of(shard):
            writer.append(chunk)
    assert again.read_bytes() == shard.read_bytes()


def test_shard_of_an_earlier_version_is_sound(recorded: Path) -> None:
    assert validate(recorded).ok


def test_mapping_comes_back() -> None:
    whole = dataclasses.replace(PROVENANCE, scenarios=ScenarioOrigin(name="five.toml", sha256="ef" * 32))
    for provenance in (whole, PROVENANCE, Provenance()):
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


@pytest.mark.parametrize("config", [{"renderer": 3}, {"renderer": {"sensor": {"ranges": {"k1": 7}}}}, {"renderer": []}])
def test_settings_of_another_shape_are_refused_when_they_are_asked_for(config: dict[str, object]) -> None:
    provenance = provenance_from_strings(provenance_to_strings(dataclasses.replace(PROVENANCE, config=config)))
    with pytest.raises(ConfigError, match=r"settings are none|sensor"):
        _ = provenance.sensor


def test_deep_metadata_is_refused() -> None:
    with pytest.raises(DatasetError, match="nest deeper"):
        provenance_from_strings({"format": "[" * 100_000})
