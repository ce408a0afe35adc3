import dataclasses

import numpy as np

from readygo.common.robot import RobotConfig
from readygo.services.trainer.goals import hindsight_goals
from readygo.services.trainer.samples import Timing, episode_table, join_tables
from tests.services.trainer.conftest import make_one


def straight_drives(**fields):
    """Episodes that drive along +x while they look along +y."""
    tables = []
    for k in range(3):
        xyyaw = np.stack([np.arange(40) * 0.19, np.full(40, 100.0 * k), np.full(40, np.pi / 2)], axis=1)
        tables.append(episode_table(make_one(f"e{k}", xyyaw=xyyaw, **fields), RobotConfig(), Timing(spacing_steps=10)))
    return join_tables(tables)


def test_hindsight_goal_is_a_place_that_the_robot_reached_later_in_its_episode():
    table, samples = straight_drives(), np.arange(120)
    goals = hindsight_goals(table, samples, 1.0, np.random.default_rng(0)).xy_m
    replaced = np.any(goals != table.goals_xy_m, axis=1)
    # Whatever comes later is to the right.
    np.testing.assert_allclose(goals[replaced, 0], 0.0, atol=1e-5)
    steps_later = -goals[replaced, 1] / 0.19
    np.testing.assert_allclose(steps_later, np.round(steps_later), atol=1e-4)
    assert np.all(steps_later <= (table.last - samples)[replaced] + 1e-4)
    assert np.all(-goals[replaced, 1] > 1.0)
    assert not replaced[(table.last - samples) * 0.19 <= 1.0].any()


def test_hindsight_goals_end_where_the_expert_was_disturbed():
    calm = make_one("e0")
    expert = np.repeat(calm.actions[:, None], 2, axis=1)
    expert[20, 0] += 0.3
    xyyaw = np.stack([np.arange(40) * 0.19, np.zeros(40), np.full(40, np.pi / 2)], axis=1)
    table = episode_table(
        dataclasses.replace(calm, xyyaw=xyyaw, expert=expert), RobotConfig(), Timing(spacing_steps=10)
    )
    samples = np.arange(40)
    for seed in range(20):
        goals = hindsight_goals(table, samples, 1.0, np.random.default_rng(seed)).xy_m
        replaced = np.any(goals != table.goals_xy_m, axis=1)
        reached = np.round(-goals[:, 1] / 0.19) + samples
        assert not replaced[20]
        assert np.all(reached[:20][replaced[:20]] <= 20)


def test_hindsight_share_zero_keeps_every_goal():
    table = straight_drives()
    goals = hindsight_goals(table, np.arange(60), 0.0, np.random.default_rng(0)).xy_m
    np.testing.assert_array_equal(goals, table.goals_xy_m[:60])
