import dataclasses

import numpy as np
import pytest

from readygo.common.errors import DatasetError
from readygo.common.messages.plan import Driver
from readygo.common.policy.motion import odometry
from readygo.common.robot import RobotConfig
from readygo.services.trainer.samples import (
    Timing,
    draw_samples,
    episode_table,
    held_out_names,
    join_tables,
    make_batch,
    name_rank,
    spread_samples,
)
from tests.services.trainer.conftest import make_one

TIMING = Timing(spacing_steps=10)


@pytest.fixture
def table():
    return join_tables([episode_table(make_one(f"e{k}", samples=60), RobotConfig(), TIMING) for k in range(6)])


def test_window_is_two_spacings_ago_one_ago_and_now(table):
    batch = make_batch(np.array([85]), table.first, TIMING)
    assert batch.frames[batch.window].tolist() == [[65, 75, 85]]


def test_window_repeats_the_first_frame_of_its_own_episode(table):
    batch = make_batch(np.array([60, 65, 74]), table.first, TIMING)
    assert batch.frames[batch.window].tolist() == [[60, 60, 60], [60, 60, 65], [60, 64, 74]]


def test_latency_pairs_a_sample_with_older_frames_of_its_own_episode(table):
    batch = make_batch(np.array([60, 63, 85]), table.first, Timing(spacing_steps=10, latency_steps=2))
    assert batch.frames[batch.window].tolist() == [[60, 60, 60], [60, 60, 61], [63, 73, 83]]


def test_shared_frames_are_listed_once(table):
    assert make_batch(np.array([20, 30, 40, 50]), table.first, TIMING).frames.tolist() == [0, 10, 20, 30, 40, 50]


def sparse(episode, every):
    """The same with images and answers of the expert at every n-th sample alone."""
    missing = np.arange(episode.sample_count) % every > 0
    expert = np.repeat(episode.actions[:, None], 3, axis=1)
    expert[missing] = np.nan
    images = tuple(b"" if gone else image for gone, image in zip(missing, episode.images, strict=True))
    return dataclasses.replace(episode, images=images, expert=expert)


def test_only_samples_whose_window_was_taken_are_drawn():
    table = join_tables(
        [episode_table(sparse(make_one(f"e{k}", samples=62), 5), RobotConfig(), TIMING) for k in range(2)]
    )
    assert np.array_equal(table.usable_samples, [*range(0, 62, 5), *range(62, 124, 5)])
    rng = np.random.default_rng(0)
    drawn = draw_samples(table, batch_size=500, chain_length=3, spacing_steps=10, rng=rng)
    assert len(drawn) == 500
    assert set(drawn.tolist()) == set(table.usable_samples.tolist())
    assert np.array_equal(spread_samples(table, 9), table.usable_samples[::3])


def test_pictures_that_no_window_meets_are_refused_with_the_setting():
    table = join_tables(
        [episode_table(sparse(make_one(samples=62), 4), RobotConfig(), Timing(spacing_steps=10, latency_steps=1))]
    )
    with pytest.raises(DatasetError, match="camera_hz that divides"):
        _ = table.usable_samples


def test_joined_tables_count_through(table):
    assert table.first[[0, 59, 60]].tolist() == [0, 0, 60]
    assert table.last[[0, 60]].tolist() == [59, 119]
    assert table.names[table.episode[61]] == "e1"
    with pytest.raises(DatasetError, match="no episode"):
        join_tables([])


def test_own_motion_is_that_of_the_executed_commands():
    episode = make_one(samples=60)
    table = episode_table(episode, RobotConfig(), TIMING)
    assert np.all(table.motion[0] == 0)
    assert np.array_equal(table.motion[1:, 6:], episode.actions[:-1])
    poses = odometry(episode.actions, 0.05)
    assert table.motion[30, 5] == pytest.approx(poses[20, 2] - poses[30, 2], abs=1e-5)
    assert table.motion[30, 2] == pytest.approx(poses[10, 2] - poses[30, 2], abs=1e-5)


def test_targets_are_the_expert_s_commands_ahead():
    expert = np.arange(40 * 5 * 2, dtype=np.float32).reshape(40, 5, 2)
    timing = Timing(spacing_steps=10, ahead_steps=3)
    assert np.array_equal(episode_table(make_one(expert=expert), RobotConfig(), timing).targets, expert[:, 3])


def test_without_an_expert_targets_are_what_was_executed_then():
    episode = make_one()
    targets = episode_table(episode, RobotConfig(), Timing(spacing_steps=10, ahead_steps=3)).targets
    assert np.array_equal(targets[:-3], episode.actions[3:])
    assert np.array_equal(targets[-3:], episode.actions[[-1, -1, -1]])


def test_expert_has_driven_up_to_where_it_was_disturbed():
    episode = make_one(samples=8)
    expert = np.repeat(episode.actions[:, None], 2, axis=1)
    expert[[3, 5], 0] += 0.2
    table = episode_table(make_one(samples=8, expert=expert), RobotConfig(), TIMING)
    assert table.driven_last.tolist() == [3, 3, 3, 3, 5, 5, 7, 7]
    driven = episode_table(make_one(samples=8, expert=expert, driver=Driver.POLICY), RobotConfig(), TIMING)
    assert driven.driven_last.tolist() == list(range(8))
    assert driven.by_policy.all()


def test_draws_have_the_size_asked_for_and_are_a_function_of_the_generator(table):
    draws = [
        draw_samples(table, batch_size=50, chain_length=8, spacing_steps=10, rng=np.random.default_rng(seed))
        for seed in (1, 1, 2)
    ]
    assert len(draws[0]) == 50
    assert np.array_equal(draws[0], draws[1])
    assert not np.array_equal(draws[0], draws[2])


def test_every_sample_is_drawn_about_as_often(table):
    rng = np.random.default_rng(0)
    draws = [draw_samples(table, batch_size=64, chain_length=4, spacing_steps=10, rng=rng) for _ in range(1500)]
    counts = np.bincount(np.concatenate(draws), minlength=len(table))
    assert counts.min() > 0.3 * counts.mean()
    assert counts.max() < 2.5 * counts.mean()


def test_chains_share_most_frames():
    table = join_tables([episode_table(make_one(f"e{k}", samples=400), RobotConfig(), TIMING) for k in range(4)])
    samples = draw_samples(table, batch_size=128, chain_length=16, spacing_steps=10, rng=np.random.default_rng(0))
    assert len(make_batch(samples, table.first, TIMING).frames) < 1.35 * 128


def test_held_out_names_do_not_depend_on_their_order():
    names = [f"e{k}" for k in range(20)]
    held_out = held_out_names(names, 0.2)
    assert len(held_out) == 4
    assert held_out_names(names[::-1], 0.2) == held_out
    assert [len(held_out_names(names[:2], fraction)) for fraction in (0.0, 0.9)] == [1, 1]
    with pytest.raises(DatasetError, match="2 or more episodes"):
        held_out_names(names[:1], 0.2)


def test_ranks_of_names_are_even():
    assert sum(name_rank(f"e{k}") < 0.1 for k in range(2000)) == pytest.approx(200, abs=50)


def test_spread_samples_are_even_and_limited(table):
    assert spread_samples(table, 100).tolist() == list(range(0, 360, 4))
