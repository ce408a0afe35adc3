import numpy as np
import pytest

from readygo.common.errors import DatasetError
from readygo.services.trainer.samples import build_table, epoch_samples, make_batch, split_episodes, spread_samples


def epoch(source, seed=0, **settings):
    settings = {"spacing_steps": 10, "chain_length": 8, "batch_size": 64} | settings
    return epoch_samples(source.episodes, rng=np.random.default_rng(seed), **settings)


def test_window_is_two_spacings_ago_one_ago_and_now(source):
    batch = make_batch(np.array([85]), build_table(source).first, 10)
    assert batch.frames[batch.window].tolist() == [[65, 75, 85]]


def test_window_repeats_the_first_frame_of_its_own_episode(source):
    batch = make_batch(np.array([60, 65, 74]), build_table(source).first, 10)
    assert batch.frames[batch.window].tolist() == [[60, 60, 60], [60, 60, 65], [60, 64, 74]]


def test_latency_pairs_a_sample_with_older_frames_of_its_own_episode(source):
    batch = make_batch(np.array([60, 63, 85]), build_table(source).first, 10, 2)
    assert batch.frames[batch.window].tolist() == [[60, 60, 60], [60, 60, 61], [63, 73, 83]]


def test_shared_frames_are_listed_once(source):
    batch = make_batch(np.array([20, 30, 40, 50]), build_table(source).first, 10)
    assert batch.frames.tolist() == [0, 10, 20, 30, 40, 50]


def test_previous_action_is_zero_at_the_start_of_each_episode(source):
    table = build_table(source)
    assert np.all(table.previous[[0, 60, 120]] == 0)
    assert np.array_equal(table.previous[61:120], source.actions[60:119])


def test_epoch_shows_every_sample_once(source):
    samples = np.concatenate(epoch(source))
    assert sorted(samples.tolist()) == list(range(360))


def test_epoch_is_a_function_of_its_generator(source):
    first, again, other = epoch(source, 1), epoch(source, 1), epoch(source, 2)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(np.concatenate(first), np.concatenate(other))


def test_batches_have_about_the_size_asked_for(source):
    assert {len(batch) for batch in epoch(source, batch_size=50)} <= {51, 52}


def test_chains_share_most_frames(make_data):
    source = make_data(episodes=4, samples=400)
    first = build_table(source).first
    frames = sum(len(make_batch(batch, first, 10).frames) for batch in epoch(source, chain_length=16))
    assert frames < 1.35 * 1600


def test_split_holds_out_whole_episodes_whatever_their_order(make_data):
    episodes = make_data(episodes=20).episodes
    training, held_out = split_episodes(episodes, 0.2)
    assert len(training) == 16
    assert {e.first_sample for e in training} | {e.first_sample for e in held_out} == {60 * i for i in range(20)}
    shuffled_training, shuffled_held_out = split_episodes(episodes[::-1], 0.2)
    assert [e.episode for e in shuffled_training] == [e.episode for e in training]
    assert [e.episode for e in shuffled_held_out] == [e.episode for e in held_out]


def test_split_leaves_something_on_both_sides(make_data):
    for fraction in (0.0, 0.9):
        training, held_out = split_episodes(make_data(episodes=2).episodes, fraction)
        assert len(training) == len(held_out) == 1


def test_one_episode_cannot_be_split(make_data):
    with pytest.raises(DatasetError, match="2 or more episodes"):
        split_episodes(make_data(episodes=1).episodes, 0.2)


def test_spread_samples_are_even_and_limited(source):
    assert spread_samples(source.episodes, 100).tolist() == list(range(0, 360, 4))
