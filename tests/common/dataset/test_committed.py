import dataclasses
import os
import re
from pathlib import Path

import numpy as np
import pytest

from readygo.common.dataset import ShardWriter, committed_episodes, encode_episode, shard_name
from readygo.common.dataset.committed import episode_indices, episode_keys
from readygo.common.errors import DatasetError
from readygo.common.messages import CommittedEpisode, DriverKind, EpisodeKey, Outcome, Split, decode, encode
from readygo.common.robot import RobotConfig
from tests import crooked
from tests.common.dataset.episodes import PROVENANCE, make_episode, write_shard

NAMES = ("depth", "mask", "joints", "boxes", "footprints", "expert", "drawn")


def _key(index: int) -> EpisodeKey:
    return EpisodeKey(seed=7, split=Split.TRAIN, index=index)


def _indices(folder: Path, *known: int) -> list[int]:
    return [found.header.episode.index for found in committed_episodes(folder, {_key(index) for index in known})]


def _whole_episode() -> CommittedEpisode:
    """With all that a driven episode can have."""
    header, samples = make_episode(
        4,
        outputs=("depth", "mask"),
        labels=True,
        outcome=Outcome.HUMAN_COLLISION,
        driver=DriverKind.POLICY,
        policy="ab" * 32,
        drawn={"mount_height_m": 0.3, "v_max_mps": 0.9},
        distortion_model="plumb_bob",
        distortion=(0.1, -0.2, 0.3, 0.4, 0.5),
    )
    asked = tuple(
        dataclasses.replace(sample, expert_commands=((0.5, 0.1), (0.25, -0.1)), risks=bytes(45)) for sample in samples
    )
    return CommittedEpisode(header=header, attempt=3, samples=asked)


def test_episode_comes_back_as_it_was_published(tmp_path: Path) -> None:
    want = decode(CommittedEpisode, encode(_whole_episode()))
    with ShardWriter(tmp_path / shard_name("r0", 0), PROVENANCE, outputs=NAMES, fsync=False) as writer:
        writer.append(encode_episode(want.header, want.attempt, want.samples))
    (got,) = committed_episodes(tmp_path)
    assert (got.header, got.attempt) == (want.header, 3)
    for sample, other in zip(got.samples, want.samples, strict=True):
        plain = {"labels": (), "robot_xyzyaw": (), "humans_xyzyaw": ()}
        assert dataclasses.replace(sample, **plain) == dataclasses.replace(other, **plain)
        assert sample.intact
        np.testing.assert_allclose(sample.robot_xyzyaw, other.robot_xyzyaw, atol=1e-12)
        np.testing.assert_allclose(sample.humans_xyzyaw, other.humans_xyzyaw, atol=1e-12)
        np.testing.assert_array_equal(sample.labels[0].joints_m, other.labels[0].joints_m)
        np.testing.assert_array_equal(sample.labels[0].footprint_xy_m, other.labels[0].footprint_xy_m)
        np.testing.assert_allclose(sample.labels[0].box, other.labels[0].box, atol=1e-12)


def test_finished_and_open_shards_are_read_and_what_is_known_is_left_out(tmp_path: Path) -> None:
    write_shard(tmp_path, [0, 2])
    writer = ShardWriter(tmp_path / shard_name("r0", 1), PROVENANCE, fsync=False)
    assert _indices(tmp_path) == [0, 2]
    for index in (1, 5):
        writer.append(encode_episode(*_episode(index)))
        assert _indices(tmp_path, 0, 2)[-1] == index
    assert _indices(tmp_path, 0, 1) == [2, 5]
    writer.close()
    assert _indices(tmp_path, 0, 1) == [2, 5]


def _episode(index: int) -> tuple:
    header, samples = make_episode(index)
    return header, 1, samples


def test_open_shard_ends_after_its_last_whole_episode_wherever_it_is_cut(tmp_path: Path) -> None:
    data = write_shard(tmp_path / "whole", [0, 1]).read_bytes()
    second = data.rindex(b"train-7-000001", 0, data.rindex(b"train-7-000001"))
    part = tmp_path / (shard_name("r0", 0) + ".part")
    cuts = {0: [], 5: [], 40: [], 2000: [], second: [0], second + 3000: [0], len(data) - 30: [0, 1]}
    for end, whole in cuts.items():
        part.write_bytes(data[:end])
        assert _indices(tmp_path) == whole


def test_damaged_episode_of_an_open_shard_ends_it(tmp_path: Path) -> None:
    data = bytearray(write_shard(tmp_path / "whole", [0, 1]).read_bytes())
    data[data.rindex(b"train-7-000001") - 400] ^= 1
    (tmp_path / (shard_name("r0", 0) + ".part")).write_bytes(data)
    assert _indices(tmp_path) == [0]


@pytest.mark.parametrize("size", [0, 100, 9000, -200])
def test_finished_shard_that_is_cut_off_is_named(tmp_path: Path, size: int) -> None:
    shard = write_shard(tmp_path, [0, 1])
    shard.write_bytes(shard.read_bytes()[:size])
    with pytest.raises(DatasetError, match=rf"Shard {re.escape(str(shard))} cannot be read: .*readygo validate"):
        list(committed_episodes(tmp_path))


def test_shard_that_was_finished_meanwhile_is_found_under_its_name(tmp_path: Path) -> None:
    write_shard(tmp_path, [0])
    part = tmp_path / (shard_name("r0", 1) + ".part")
    part.write_bytes(write_shard(tmp_path / "other", [3]).read_bytes())
    found = committed_episodes(tmp_path)
    assert next(found).header.episode.index == 0
    part.rename(part.with_suffix(""))
    assert [episode.header.episode.index for episode in found] == [3]


def test_pipe_that_is_called_as_a_shard_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "shard-rec0-00000.mcap")
    with pytest.raises(DatasetError, match=r"shard-rec0-00000\.mcap cannot be read: it is a pipe or a device"):
        list(committed_episodes(tmp_path))
    assert episode_keys(tmp_path / "shard-rec0-00000.mcap") == []
    assert list(episode_indices(tmp_path / "shard-rec0-00000.mcap")) == []


@pytest.mark.parametrize("robot", [crooked.ROBOT, crooked.ODD_RATES], ids=["20 Hz", "30 Hz"])
def test_episodes_of_a_crooked_robot_come_back_as_they_were(tmp_path: Path, robot: RobotConfig) -> None:
    crooked.write_crooked_shard(tmp_path, (8, 3), 13, robot=robot)
    found = {one.header.episode.index: one for one in committed_episodes(tmp_path)}
    assert list(found) == [8, 3]
    for index, got in found.items():
        header, samples = crooked.crooked_episode(index, 13, robot=robot)
        assert (got.header, got.attempt) == (header, 2)
        for sample, want in zip(got.samples, samples, strict=True):
            poses = {"robot_xyzyaw": (), "humans_xyzyaw": ()}
            assert dataclasses.replace(sample, **poses) == dataclasses.replace(want, **poses)
            np.testing.assert_allclose(sample.robot_xyzyaw, want.robot_xyzyaw, atol=1e-12)
            np.testing.assert_allclose(sample.humans_xyzyaw, want.humans_xyzyaw, atol=1e-12)
