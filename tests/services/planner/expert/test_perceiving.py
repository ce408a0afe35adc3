import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import run_episode
from readygo.common.messages import EpisodeMotions, HumanTrajectory, Outcome, Scenario
from readygo.common.perception.noise import EXACT, PERCEIVED
from readygo.common.perception.people import NOBODY, People
from readygo.common.policy.memory import PolicyMemory
from readygo.services.planner import ExpertDriver, RobotPlanner
from readygo.services.planner.expert.perceiving import PerceivingDriver
from tests.services.planner.worlds import animate, key, make_robot_planner


def frontal() -> Scenario:
    """Somebody walks towards the robot, on its way."""
    steps = np.arange(400)
    track = np.stack([np.clip(2.4 - 0.05 * steps, -2.6, None), np.full(400, 5.5)], axis=1)
    human = HumanTrajectory(avatar="mia", encounter="frontal", speed_mps=1.0, xy_m=track)
    return Scenario(
        episode=key(0), start_xyyaw=np.array([-2.0, 5.5, 0.0]), goal_xy_m=np.array([2.2, 5.5]), humans=(human,)
    )


@pytest.fixture(scope="module")
def planner() -> RobotPlanner:
    return make_robot_planner()


def simulation(planner: RobotPlanner) -> EpisodeSimulation:
    scenario = frontal()
    return planner.simulation(scenario, animate(scenario))


class Seeing:
    """Perceives those in view as they are, or nobody; the camera gives the simulation itself."""

    def __init__(self, *, blind: bool = False) -> None:
        self.blind, self.looks = blind, 0

    def start(self) -> PolicyMemory:
        return PolicyMemory(200_000_000)

    def arrives(self, simulation: EpisodeSimulation) -> bool:
        return True

    def look(self, simulations: list[EpisodeSimulation]) -> np.ndarray:
        self.looks += len(simulations)
        self.simulations = list(simulations)
        return np.zeros((len(simulations), 2, 2, 3), np.uint8)

    def perceive(self, memory: PolicyMemory, command: np.ndarray) -> SimpleNamespace:
        (one,) = self.simulations
        x, y = (one.human_xy_m[0] - (one.x_m, one.y_m)).tolist()
        c, s = math.cos(one.yaw_rad), math.sin(one.yaw_rad)
        ahead, left = c * x + s * y, c * y - s * x
        if self.blind or ahead < abs(left):
            return SimpleNamespace(people=NOBODY)
        people = People(
            presence=np.array([0.95]),
            xy_m=np.array([[ahead, left]]),
            place_cov=0.01**2 * np.eye(2)[None],
            v_mps=np.zeros((1, 2)),
            velocity_cov=9.0 * np.eye(2)[None],
        )
        return SimpleNamespace(people=people)


def drive(planner: RobotPlanner, seeing: Seeing) -> EpisodeSimulation:
    driver = PerceivingDriver(seeing, seeing, lambda one: planner.tracked_expert(one.scenario))  # type: ignore[arg-type]
    one = simulation(planner)
    run_episode(one, driver)
    return one


def test_who_sees_goes_around_the_human_and_who_does_not_meets_it(planner: RobotPlanner) -> None:
    seeing, blind = Seeing(), Seeing(blind=True)
    assert drive(planner, blind).outcome is Outcome.HUMAN_COLLISION
    one = drive(planner, seeing)
    assert one.outcome is Outcome.SUCCESS
    # Ten looks a second.
    assert seeing.looks == -(-one.step // 2)


def test_driver_does_not_know_the_humans_of_the_simulation(planner: RobotPlanner) -> None:
    """A blind driver drives as in an empty scene, up to the contact."""
    met = drive(planner, Seeing(blind=True))
    scenario = frontal()
    empty = Scenario(
        episode=scenario.episode, start_xyyaw=scenario.start_xyyaw, goal_xy_m=scenario.goal_xy_m, humans=()
    )
    alone = planner.simulation(empty, EpisodeMotions(humans=()))
    run_episode(alone, ExpertDriver(planner.expert))
    np.testing.assert_array_equal(met.path_xyyaw(0, met.step - 1), alone.path_xyyaw(0, met.step - 1))


def test_expert_with_a_students_eyes_does_so_too_and_errs_the_same_way_again(planner: RobotPlanner) -> None:
    ends = []
    for noise in (EXACT, PERCEIVED, PERCEIVED):
        one = simulation(planner)
        run_episode(one, ExpertDriver(lambda scenario, _, noise=noise: planner.detecting_expert(scenario, noise)))  # type: ignore[misc]
        ends.append((one.outcome, one.step, one.x_m))
    assert ends[0][0] is Outcome.SUCCESS
    assert ends[1] == ends[2]
    assert ends[0] != ends[1]


def test_expert_with_a_students_eyes_knows_the_same_if_it_is_asked_again_or_only_watches(planner: RobotPlanner) -> None:
    one = simulation(planner)
    asked, watches = (planner.detecting_expert(one.scenario, PERCEIVED) for _ in range(2))
    sees_all, seen = planner.expert(one.scenario, one.motions), []
    for _ in range(60):
        decision, again = asked.act(one), asked.act(one)
        assert np.array_equal(again.commands, decision.commands)
        seen.append(decision.visible)
        assert watches.watch(one) == sees_all.watch(one) == seen[-1]
        if one.step % 20 == 19:
            known = [[human.x_m for human in each.perceived] for each in (watches.act(one), decision)]
            assert known[0] == known[1]
        one.advance(0.5, 0.4)
    assert set(seen) == {False, True}


def test_expert_with_a_students_eyes_looks_as_often_as_its_noise_says(planner: RobotPlanner) -> None:
    one, places = simulation(planner), []
    expert = planner.detecting_expert(one.scenario, dataclasses.replace(EXACT, rate_hz=5.0))
    for _ in range(9):
        places.append([human.age_s for human in expert.act(one).perceived])
        one.advance(0.0, 0.0)
    np.testing.assert_allclose(np.ravel(places), [0.0, 0.05, 0.1, 0.15, 0.0, 0.05, 0.1, 0.15, 0.0], atol=1e-9)
