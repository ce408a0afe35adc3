import numpy as np
import pytest

from readygo.common.errors import DatasetError
from readygo.common.robot import CameraConfig
from readygo.services.trainer import TrainConfig
from readygo.services.trainer.parts import build_parts, robot_of_source

CONFIG = TrainConfig(validation_fraction=0.2)


def test_part_is_held_out_of_one_source_and_shares_its_frames(make_data):
    source = make_data(episodes=10)
    training, held_out = build_parts(source, None, CONFIG)
    assert (len(training.episodes), len(held_out.episodes)) == (8, 2)
    firsts = [episode.first_sample for part in (training, held_out) for episode in part.episodes]
    assert sorted(firsts) == [episode.first_sample for episode in source.episodes]
    assert training.frames is held_out.frames
    assert training.source is held_out.source is source


def test_each_of_two_sources_keeps_its_own_episodes_numbers_and_frames(make_data):
    source, validation = make_data(), make_data(episodes=2, seed=1)
    training, held_out = build_parts(source, validation, CONFIG)
    for part, of in ((training, source), (held_out, validation)):
        assert part.source is of
        assert part.episodes == of.episodes
        assert np.array_equal(part.table.actions, of.actions)
        assert np.array_equal(part.frames.get(np.array([5]))[0], of.decode(5))


def test_most_of_the_cache_is_for_training(make_data):
    camera = CameraConfig(height_px=32, width_px=64)
    frames = 1_000_000 // (32 * 64 * 3)
    source, validation = make_data(samples=200, camera=camera), make_data(samples=200, seed=1, camera=camera)
    parts = build_parts(source, validation, TrainConfig(cache_mb=1))
    for part, of, share in zip(parts, (source, validation), (0.8, 0.2), strict=True):
        part.frames.get(np.arange(frames))
        again = of.decoded
        part.frames.get(np.arange(frames))
        assert frames - (of.decoded - again) == pytest.approx(share * frames, abs=1)


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
