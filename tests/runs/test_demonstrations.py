import numpy as np
import pytest

from readygo.common.messages import Split
from readygo.common.state_simulation.world import ObservationConfig
from readygo.runs.config import RunConfig
from readygo.runs.demonstrations import Teacher
from readygo.runs.evaluation import evaluation_world
from readygo.runs.state_world import goal_distances, state_world
from tests.common.state_policy.state_policies import TOLD_COUNT, make_state_policy


@pytest.fixture(scope="module")
def world():
    return evaluation_world("embedded", RunConfig(), avatars=None, seed=0, split=Split.TRAIN)


def make(world) -> Teacher:
    return Teacher(world, state_world(world, ObservationConfig()), goal_distances(world))


def test_expert_labels_every_decision_and_repeats_itself(world) -> None:
    first, second = (make(world).teach(make_state_policy(), 2, alone=True) for _ in range(2))
    assert first.told.shape == (len(first.shares), TOLD_COUNT)
    assert len(first.shares) > 20
    assert np.array_equal(first.told, second.told)
    assert np.array_equal(first.shares, second.shares)
    assert first.shares[:, 0].max() > 0.5
    assert len(first.joined(second).told) == 2 * len(first.told)


def test_policy_visits_other_states_than_the_expert(world) -> None:
    teacher = make(world)
    teacher._rng = np.random.default_rng(1)
    visited = teacher.teach(make_state_policy(), 3, alone=False)
    alone = make(world).teach(make_state_policy(), 3, alone=True)
    assert not np.array_equal(visited.told[: len(alone.told)], alone.told[: len(visited.told)])
