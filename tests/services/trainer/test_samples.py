import dataclasses

import numpy as np
import pytest

from readygo.common.errors import DatasetError
from readygo.common.messages.plan import DriverKind
from readygo.common.policy import PolicyMemory
from readygo.common.policy.motion import odometry
from readygo.common.robot import Clock, RobotConfig
from readygo.common.robot.command_grid import UNKNOWN_RISK
from readygo.common.robot.ranges import RobotRanges
from readygo.services.trainer.samples import (
    WindowTiming,
    chain_rows,
    draw_samples,
    episode_table,
    held_out_names,
    join_tables,
    make_batch,
    name_rank,
    spread_chains,
    spread_samples,
)
from tests import crooked
from tests.services.trainer.conftest import make_one

TIMING = WindowTiming(spacing_steps=10)


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
    batch = make_batch(np.array([60, 63, 85]), table.first, WindowTiming(spacing_steps=10, latency_steps=2))
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
        [episode_table(sparse(make_one(samples=62), 4), RobotConfig(), WindowTiming(spacing_steps=10, latency_steps=1))]
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
    timing = WindowTiming(spacing_steps=10, ahead_steps=3)
    assert np.array_equal(episode_table(make_one(expert=expert), RobotConfig(), timing).targets, expert[:, 3])


def test_without_an_expert_targets_are_what_was_executed_then():
    episode = make_one()
    targets = episode_table(episode, RobotConfig(), WindowTiming(spacing_steps=10, ahead_steps=3)).targets
    assert np.array_equal(targets[:-3], episode.actions[3:])
    assert np.array_equal(targets[-3:], episode.actions[[-1, -1, -1]])


@pytest.mark.parametrize("ahead_steps", [0, 4])
@pytest.mark.parametrize("with_expert", [False, True])
def test_sample_teaches_what_is_executed_at_the_end_of_its_held_command(ahead_steps, with_expert):
    clock = Clock(rate_hz=30, control_every=3, image_every=2)
    timing = WindowTiming(spacing_steps=10, ahead_steps=ahead_steps, clock=clock)
    expert = np.arange(40 * 9 * 2, dtype=np.float32).reshape(40, 9, 2) if with_expert else None
    episode = make_one(expert=expert)
    table = episode_table(episode, RobotConfig(), timing)
    for step in range(0, 30, 3):
        end = step + ahead_steps + 2
        assert (
            table.targets[step].tolist() == (expert[step, end - step] if with_expert else episode.actions[end]).tolist()
        )
    assert table.usable.tolist() == [step % 3 == 0 for step in range(40)]


def test_odometry_and_windows_follow_the_robots_clock():
    clock = Clock(rate_hz=30, control_every=3, image_every=2)
    episode = sparse(make_one(samples=60), 2)
    table = episode_table(episode, RobotConfig(), WindowTiming(spacing_steps=10, latency_steps=3, clock=clock))
    poses = odometry(episode.actions, 1 / 30)
    # Step 33 sees the image of 30, those 10 and 20 steps before it, and moved since then.
    assert table.motion[33, [2, 5]] == pytest.approx(poses[[10, 20], 2] - poses[33, 2], abs=1e-5)
    assert np.array_equal(table.motion[33, -2:], episode.actions[32])
    to_image = WindowTiming(spacing_steps=10, latency_steps=3, clock=clock, to_image=True)
    motion = episode_table(episode, RobotConfig(), to_image).motion
    assert motion[33, [2, 5]] == pytest.approx(poses[[10, 20], 2] - poses[30, 2], abs=1e-5)
    assert np.array_equal(motion[33, -2:], episode.actions[32])
    assert table.pictured_at[[32, 33, 34]].tolist() == [32, 32, 34]
    batch = make_batch(np.array([33, 36]), table.first, WindowTiming(spacing_steps=10, latency_steps=3, clock=clock))
    assert batch.frames[batch.window].tolist() == [[10, 20, 30], [12, 22, 32]]


def test_robots_of_ranges_tell_their_own_limits():
    robot = RobotConfig(ranges=RobotRanges(v_max_mps=(0.5, 1.5), w_max_radps=(0.7, 1.3)))
    drawn = [{"v_max_mps": 0.6, "w_max_radps": 1.1}, {"v_max_mps": 1.4, "w_max_radps": 0.8}]
    table = join_tables(
        [episode_table(make_one(f"e{k}", samples=4, drawn=d), robot, TIMING) for k, d in enumerate(drawn)]
    )
    assert table.limits(np.array([5, 2])).tolist() == pytest.approx(np.float32([[1.4, 0.8], [0.6, 1.1]]))


def test_what_the_data_do_not_tell_is_unknown():
    table = episode_table(make_one(samples=5), RobotConfig(), TIMING)
    assert (table.risks == UNKNOWN_RISK).all()
    assert np.isnan(table.humans).all()
    risks = np.zeros((5, 3), np.uint8)
    with pytest.raises(DatasetError, match="the risks of 3 commands"):
        episode_table(make_one(samples=5, risks=risks), RobotConfig(), TIMING)


def test_usable_share_that_is_just_enough_is_taken(table):
    few = dataclasses.replace(table, usable=np.arange(len(table)) < 18)
    assert len(few.usable_samples) == 18
    with pytest.raises(DatasetError, match="Only 17 of 360"):
        _ = dataclasses.replace(table, usable=np.arange(len(table)) < 17).usable_samples


def test_chains_stay_in_their_episode_and_reach_its_ends(table):
    rng = np.random.default_rng(3)
    drawn = [draw_samples(table, batch_size=7, chain_length=4, spacing_steps=10, rng=rng) for _ in range(300)]
    for samples in drawn:
        assert len(samples) == 7
        steps = np.diff(samples)
        same = table.episode[samples[1:]] == table.episode[samples[:-1]]
        assert (steps[same & (steps > 0) & (steps < 40)] % 10 == 0).mean() > 0.5
    found = np.unique(np.concatenate(drawn))
    assert {0, 59, 60, 359} <= set(found.tolist())


def test_expert_has_driven_up_to_where_it_was_disturbed():
    episode = make_one(samples=8)
    expert = np.repeat(episode.actions[:, None], 2, axis=1)
    expert[[3, 5], 0] += 0.2
    table = episode_table(make_one(samples=8, expert=expert), RobotConfig(), TIMING)
    assert table.driven_last.tolist() == [3, 3, 3, 3, 5, 5, 7, 7]
    driven = episode_table(make_one(samples=8, expert=expert, driver=DriverKind.POLICY), RobotConfig(), TIMING)
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


def test_chains_end_with_the_episode_and_where_samples_are_not_next_to_each_other():
    samples = np.array([3, 5, 7, 13, 15, 30, 32, 40])
    first = np.array([0, 0, 0, 0, 0, 0, 32, 32])
    rows = chain_rows(samples, first, 2)
    assert rows.tolist() == [[0, 1, 2], [3, 4, -1], [5, -1, -1], [6, -1, -1], [7, -1, -1]]
    assert rows[rows >= 0].tolist() == list(range(8))


def test_spread_chains_stay_in_their_episodes(table):
    chosen = spread_chains(table, 24, chain_length=4, spacing_steps=5)
    rows = chain_rows(chosen, table.first[chosen], 5)
    assert rows.shape == (6, 4)
    starts = chosen[rows[:, 0]]
    assert np.array_equal(starts, spread_samples(table, 6))
    assert all(len(set(table.first[chosen[row[row >= 0]]].tolist())) == 1 for row in rows)


@pytest.mark.parametrize("robot", [crooked.ROBOT, crooked.ODD_RATES], ids=["20 Hz", "30 Hz"])
@pytest.mark.parametrize("late_steps", [0, 3])
def test_driving_sees_the_windows_and_the_motion_that_training_shows(robot, late_steps):
    clock, spacing_steps = robot.clock, 6
    _, recorded = crooked.crooked_episode(3, 40, robot=robot)
    one = make_one(samples=40, actions=np.float32([(s.action_v_mps, s.action_w_radps) for s in recorded]))
    one = dataclasses.replace(one, images=tuple(s.image for s in recorded))
    timing = WindowTiming(spacing_steps=spacing_steps, latency_steps=late_steps, clock=clock)
    table = episode_table(one, robot, timing)
    memory = PolicyMemory(clock.time_ns(spacing_steps), clock.time_ns(late_steps), 3, clock)
    compared = 0
    for step in range(40):
        previous = one.actions[step - 1] if step else np.zeros(2, np.float32)
        memory.advance(previous)
        if clock.sees(step, late_steps):
            memory.see(np.array([clock.image_step(step, late_steps)]))
        if step % clock.control_every == 0:
            batch = make_batch(np.array([step]), table.first, timing)
            assert [int(frame.image[0]) for frame in memory.window()] == batch.frames[batch.window[0]].tolist()
            # An image of an odd step is dated between two images; the poses differ by as little.
            if step >= late_steps + 2 * spacing_steps and (step - late_steps) % clock.image_every == 0:
                assert memory.own_motion(previous) == pytest.approx(table.motion[step], abs=1e-5)
                compared += 1
    assert compared > 3
