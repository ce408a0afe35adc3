"""Shards with what the expert would do: read, indexed and checked."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.common.dataset import Dataset, ShardWriter, encode_episode, schemas, shard_name, validate
from readygo.common.dataset.committed import committed_episodes
from readygo.common.dataset.index import index_path, load_index, read_index
from readygo.common.dataset.provenance import PolicyOrigin
from readygo.common.errors import DatasetError
from readygo.common.messages import DriverKind, Outcome
from readygo.common.messages.samples import sample_crc32
from readygo.common.robot.command_grid import COMMAND_COUNT, UNKNOWN_RISK
from tests.common.dataset.episodes import PROVENANCE, make_episode, write_shard
from tests.common.dataset.forge import rewrite

ENDINGS = {0: (Outcome.STATIC_COLLISION, DriverKind.POLICY, "ab" * 32), 1: (Outcome.SUCCESS, DriverKind.EXPERT, "")}
AHEAD = 4


def _risks(index: int, seq: int) -> list[int]:
    return [(number + seq + index) % 3 for number in range(COMMAND_COUNT)]


def _asked(index: int, ahead: int = AHEAD, **changes) -> tuple:
    """Header, attempt and samples of an episode whose expert would go on as the robot does."""
    header, samples = make_episode(index, **changes)
    asked = [
        dataclasses.replace(
            s, expert_commands=((s.action_v_mps, s.action_w_radps),) * (1 + ahead), risks=bytes(_risks(index, s.seq))
        )
        if s.seq % header.image_every == 0
        else dataclasses.replace(s, image=b"", crc32=sample_crc32(b"", {}), outputs={})
        for s in samples
    ]
    return header, 1, asked


def _write(folder: Path, ahead: int = AHEAD, number: int = 0, first: int = 0) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / shard_name("r0", number)
    with ShardWriter(path, PROVENANCE, outputs=("expert",), fsync=False) as writer:
        for index, (outcome, driver, policy) in ENDINGS.items():
            writer.append(encode_episode(*_asked(first + index, ahead, outcome=outcome, driver=driver, policy=policy)))
    return path


def test_dataset_gives_commands_and_endings(tmp_path: Path) -> None:
    _write(tmp_path)
    data = Dataset(tmp_path)
    assert data.has_expert
    assert (data.outputs, data.labels) == (("rgb",), ())
    assert np.array_equal(data.expert_actions, data.actions)
    assert data.expert_ahead.shape == (len(data), AHEAD, 2)
    assert np.array_equal(data.expert_ahead[:, 2], data.actions)
    assert data.has_risks
    risks = [_risks(entry.episode.index, seq) for entry in data.episodes for seq in range(entry.sample_count)]
    assert np.array_equal(data.risks, risks)
    assert [(entry.outcome, entry.driver, entry.policy) for entry in data.episodes] == [*ENDINGS.values()]


def test_images_and_the_experts_commands_at_some_samples_alone(tmp_path: Path) -> None:
    full, sparse = _asked(0, outputs=("depth",)), _asked(0, outputs=("depth",), image_every=5)
    data = []
    for name, episode in (("full", full), ("sparse", sparse)):
        (tmp_path / name).mkdir()
        path = tmp_path / name / shard_name("r0", 0)
        with ShardWriter(path, PROVENANCE, outputs=("depth", "expert"), fsync=False) as writer:
            writer.append(encode_episode(*episode))
        assert validate(path.parent).ok
        data.append(Dataset(path.parent))
    every, some = data
    taken = np.arange(len(every)) % 5 == 0
    assert every.pictured.all()
    assert np.array_equal(some.pictured, taken)
    for name in ("actions", "poses", "goals_xy_m"):
        assert np.array_equal(getattr(some, name), getattr(every, name))
    assert np.array_equal(some.expert_ahead[taken], every.expert_ahead[taken])
    assert np.isnan(some.expert_actions[~taken]).all()
    assert np.array_equal(some.risks[taken], every.risks[taken])
    assert (some.risks[~taken] == UNKNOWN_RISK).all()
    assert np.array_equal(some.decode(5), every.decode(5))
    assert np.array_equal(some.decode_output(10, "depth"), every.decode_output(10, "depth"))
    assert some.image(6) == b""
    with pytest.raises(DatasetError, match=r"Sample 6 .* has no image"):
        some.decode(6)
    (again,) = committed_episodes(tmp_path / "sparse")
    assert again.header == sparse[0]
    assert [sample.image for sample in again.samples] == [sample.image for sample in sparse[2]]
    assert [sample.expert_commands for sample in again.samples] == [sample.expert_commands for sample in sparse[2]]


@pytest.mark.parametrize(("seq", "image", "text"), [(5, b"", "sample 5 has none"), (6, b"x", "sample 6 has one")])
def test_episode_with_an_image_too_few_or_too_many_is_refused(seq: int, image: bytes, text: str) -> None:
    header, attempt, samples = _asked(0, image_every=5)
    samples[seq] = dataclasses.replace(samples[seq], image=image)
    with pytest.raises(DatasetError, match=text):
        encode_episode(header, attempt, samples)


def test_missing_image_of_a_sparse_episode_is_found(tmp_path: Path) -> None:
    path = tmp_path / shard_name("r0", 0)
    with ShardWriter(path, PROVENANCE, outputs=("expert",), fsync=False) as writer:
        writer.append(encode_episode(*_asked(0, image_every=5)))

    def without(records):
        return [record for record in records if (record.channel, record.sequence) != (schemas.IMAGE, 5)]

    rewrite(path, without)
    assert any("/camera/image lacks samples 5" in str(defect) for defect in validate(tmp_path).defects)


def test_shards_without_an_expert_are_successes_of_the_expert_and_say_how_to_get_commands(tmp_path: Path) -> None:
    write_shard(tmp_path, [0])
    data = Dataset(tmp_path)
    assert not data.has_expert
    assert (data.episodes[0].outcome, data.episodes[0].driver) == (Outcome.SUCCESS, DriverKind.EXPERT)
    with pytest.raises(
        DatasetError, match=r"no commands of the expert; record with `readygo generate --driver\.disturbed` or"
    ):
        _ = data.expert_actions
    assert not data.has_risks
    with pytest.raises(DatasetError, match="no risks of commands"):
        _ = data.risks


def test_commands_that_reach_differently_far_are_not_mixed(tmp_path: Path) -> None:
    _write(tmp_path)
    _write(tmp_path, ahead=2, number=1, first=5)
    with pytest.raises(DatasetError, match="reach differently far ahead"):
        _ = Dataset(tmp_path).expert_ahead


def test_index_keeps_endings_and_is_the_one_made_of_the_shard(tmp_path: Path) -> None:
    shard = _write(tmp_path)
    stored = read_index(index_path(shard))
    assert stored is not None
    index_path(shard).unlink()
    again = load_index(shard)
    assert stored.equals(again)
    assert [again.ending(row) for row in (0, 1)] == [*ENDINGS.values()]
    usual = dataclasses.replace(again, endings=again.endings[[1, 1]])
    assert not usual.equals(again)


def test_index_of_the_experts_successes_has_no_further_array(tmp_path: Path) -> None:
    shard = write_shard(tmp_path, [0])
    with np.load(index_path(shard)) as arrays:
        assert set(arrays.files) == {"header", "episodes", "samples"}


def test_index_of_before_policies_were_named_is_made_again(tmp_path: Path) -> None:
    shard = _write(tmp_path)
    with np.load(index_path(shard)) as arrays:
        old = {name: arrays[name] for name in arrays.files}
    old["endings"] = np.array([row.tolist()[:2] for row in old["endings"]], [("outcome", "S24"), ("driver", "S16")])
    with index_path(shard).open("wb") as file:
        np.savez(file, **old)
    assert [load_index(shard).ending(row) for row in (0, 1)] == [*ENDINGS.values()]


def test_policy_that_a_run_began_with_is_named_by_its_provenance(tmp_path: Path) -> None:
    policy = PolicyOrigin(sha256="cd" * 32, mix=0.5)
    with ShardWriter(
        tmp_path / shard_name("r0", 0), dataclasses.replace(PROVENANCE, policy=policy), outputs=("expert",), fsync=False
    ) as writer:
        for index, driver in enumerate(DriverKind):
            writer.append(encode_episode(*_asked(index, driver=driver)))
    assert [(entry.driver, entry.policy) for entry in Dataset(tmp_path).episodes] == [
        (DriverKind.EXPERT, ""),
        (DriverKind.POLICY, policy.sha256),
    ]


def test_failed_episode_of_a_policy_is_sound(tmp_path: Path) -> None:
    _write(tmp_path)
    assert validate(tmp_path).ok


def _beyond_reach(message) -> None:
    message.v_mps[2] += 0.5


def _not_finite(message) -> None:
    message.w_radps[0] = np.nan


def _too_few(message) -> None:
    del message.v_mps[-1], message.w_radps[-1]


def _uneven(message) -> None:
    del message.v_mps[-1]


@pytest.mark.parametrize("damage", [_beyond_reach, _not_finite, _too_few, _uneven])
def test_commands_that_no_robot_could_execute_are_found(tmp_path: Path, damage) -> None:
    shard = _write(tmp_path)

    def change(records):
        channel = schemas.EXPERT_CHANNELS["expert"]
        damage(next(record for record in records if record.channel is channel and record.sequence == 4).message)
        return records

    rewrite(shard, change)
    found = [str(defect) for defect in validate(tmp_path).defects]
    assert found
    assert all("action: " in text and "could not do what the expert would at samples 4" in text for text in found)


def test_unknown_outcome_is_found(tmp_path: Path) -> None:
    shard = _write(tmp_path)

    def change(records):
        channel = schemas.EXPERT_CHANNELS["expert"]
        next(record for record in records if record.channel is channel).message.outcome = "bliss"
        return records

    rewrite(shard, change)
    assert any("the end of an episode cannot be read: 'bliss'" in str(defect) for defect in validate(tmp_path).defects)
