import dataclasses

import numpy as np
import pytest

from readygo.common.errors import DatasetError
from readygo.common.robot import CameraConfig
from readygo.services.trainer import TrainConfig, best_recipe
from readygo.services.trainer.episodes import robot_of_source
from readygo.services.trainer.parts import EpisodePart, build_parts, timing_of
from tests.services.trainer.conftest import make_one

CONFIG = TrainConfig(validation_fraction=0.2)


def test_part_of_the_episodes_is_held_out(make_data):
    source = make_data(episodes=10)
    training, held_out = build_parts(source, None, CONFIG)
    assert (len(training.reservoir.episodes), len(held_out.reservoir.episodes)) == (8, 2)
    names = {*training.reservoir.episodes, *held_out.reservoir.episodes}
    assert names == {episode.sha256 for episode in source.episodes}


def test_each_of_two_sources_keeps_its_own_episodes_numbers_and_frames(make_data):
    source, validation = make_data(), make_data(episodes=2, seed=1)
    for part, of in zip(build_parts(source, validation, CONFIG), (source, validation), strict=True):
        assert list(part.reservoir.episodes) == [episode.sha256 for episode in of.episodes]
        assert np.array_equal(part.table.targets, of.actions)
        assert np.array_equal(part.frames.get(part.table, np.array([65]))[0], of.picture(65))


def test_table_follows_the_reservoir(make_data):
    robot = make_data().robot
    part = EpisodePart(robot, TrainConfig(), 1.0)
    with pytest.raises(DatasetError, match="no episode"):
        _ = part.table
    part.reservoir.add(make_one("a"))
    first = part.table
    assert part.table is first
    part.reservoir.add(make_one("b"))
    assert part.table.names == ("a", "b")


def test_memory_for_episodes_is_bounded(make_data):
    part = EpisodePart(make_data().robot, TrainConfig(memory_mb=1), 0.5)
    for k in range(30):
        part.reservoir.add(make_one(f"e{k}", size=1000))
    assert part.reservoir.size_bytes <= 500_000
    assert len(part.reservoir.episodes) > 8


def test_timing_is_that_of_camera_and_settings(make_data):
    robot = make_data().robot
    late = dataclasses.replace(robot, camera=dataclasses.replace(robot.camera, latency_s=0.1))
    timing = timing_of(late, best_recipe())
    assert (timing.spacing_steps, timing.latency_steps, timing.ahead_steps) == (10, 2, 8)


def test_sources_without_episodes_or_robot_or_of_two_robots_are_refused(make_data):
    with pytest.raises(DatasetError, match="at least one episode"):
        build_parts(make_data(), empty(make_data()), CONFIG)
    with pytest.raises(DatasetError, match="different robots"):
        build_parts(make_data(), make_data(camera=CameraConfig(height_px=8, width_px=8)), CONFIG)
    source = make_data()
    source.robot = None
    with pytest.raises(DatasetError, match="which robot"):
        robot_of_source(source)


def empty(source):
    """The source without its episodes."""
    source.episodes = []
    return source
