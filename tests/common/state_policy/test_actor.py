import math
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.perception import PeopleTracker
from readygo.common.perception.noise import EXACT, PERCEIVED, PerceptionNoise
from readygo.common.perception.people import NOBODY
from readygo.common.state_policy.actor import RobotState, StateActor, tracker_for
from readygo.common.state_simulation.observe import PEOPLE, PERSON_COUNT
from tests.common.perception.test_tracker import seen
from tests.common.state_policy.state_policies import make_state_policy
from tests.common.state_simulation.episodes import Drawn, draw


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw(1)


@pytest.fixture
def actor(drawn: Drawn) -> StateActor:
    goal = drawn.simulation(0).scenario.goal_xy_m.tolist()
    return StateActor(make_state_policy(seed=10), drawn.state_world, drawn.distances, PeopleTracker(None, None), goal)


def robot(drawn: Drawn, step: int, turned_rad: float = 0.0) -> RobotState:
    one = drawn.simulation(0)
    yaw = one.yaw_rad + turned_rad
    return SimpleNamespace(step=step, x_m=one.x_m, y_m=one.y_m, yaw_rad=yaw, v_mps=0.0, w_radps=0.0)


def test_command_is_held_until_the_next_multiple_of_its_time(drawn: Drawn, actor: StateActor) -> None:
    turns = [0.0, 1.0, 2.0, 3.0]
    decided = [actor.act(robot(drawn, step, turn)) for step, turn in zip((0, 3, 5, 8), turns, strict=True)]
    fresh = [
        StateActor(
            make_state_policy(seed=10), actor._world, drawn.distances, PeopleTracker(None, None), actor._goal
        ).act(robot(drawn, step, turn))
        for step, turn in zip((0, 5, 8), (0.0, 2.0, 3.0), strict=True)
    ]
    assert decided == [fresh[0], fresh[0], fresh[1], fresh[2]]
    assert len(set(fresh)) == 3


@pytest.mark.parametrize(("noise", "told_mps"), [(EXACT, 0.5), (PERCEIVED, 0.0)])
def test_velocities_that_images_tell_are_fused_only_if_the_policy_learned_from_such(
    noise: PerceptionNoise, told_mps: float
) -> None:
    tracker = tracker_for(make_state_policy(noise), None, None)
    tracker.fuse((0.0, 0.0, 0.0), seen((2.0, 0.0, 1.0, 0.0)), lambda x, y: True)
    velocity = tracker.tracks[0].mean[2]
    assert velocity >= told_mps if told_mps else velocity == 0.0


def test_nearest_people_are_told_with_the_age_of_their_last_detection(drawn: Drawn, actor: StateActor) -> None:
    state = robot(drawn, 6)
    pose = state.x_m, state.y_m, state.yaw_rad
    people = seen((3.0, 1.0, 0.0, 0.0), (1.5, -0.5, 0.0, 0.0))
    for step in range(0, 6, 2):
        actor.look(step, pose, people)
    actor.act(state)
    assert actor.tracks.seen_step[0, :3].tolist() == [4, 4, -1]
    here = actor.tracks.mean[0, :2, :2] - np.array(pose[:2])
    assert np.hypot(*here.T) == pytest.approx([math.hypot(1.5, 0.5), math.hypot(3.0, 1.0)], abs=0.2)
    person = actor.told[0, PEOPLE : PEOPLE + PERSON_COUNT]
    assert person[0] == 1.0


def test_nobody_is_told_where_nobody_is_seen(drawn: Drawn, actor: StateActor) -> None:
    state = robot(drawn, 0)
    actor.look(0, (state.x_m, state.y_m, state.yaw_rad), NOBODY)
    actor.act(state)
    assert (actor.tracks.seen_step == -1).all()
    assert not actor.told[0, PEOPLE : PEOPLE + 3 * PERSON_COUNT].any()
