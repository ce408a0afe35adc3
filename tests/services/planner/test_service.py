import numpy as np
import pytest

from readygo.common.bus import InProcessBus
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.messages import (
    HumanPlanReply,
    HumanPlanRequest,
    RobotPlanReply,
    RobotPlanRequest,
    decode,
    encode,
    topics,
)
from readygo.services.planner import ExpertConfig, HumanPlannerConfig
from readygo.services.planner.explain.picture import draw_episode
from readygo.services.planner.humans.config import FamilyMix
from readygo.services.planner.service import attach
from tests.services.planner.worlds import animate, key


@pytest.fixture
def bus(human_planner, robot_planner):
    bus = InProcessBus()
    attach(bus, human_planner, robot_planner)
    return bus


def test_both_topics_answer_and_their_replies_survive_the_wire(bus):
    scenario, index = None, 0
    while scenario is None:
        plan = bus.request(topics.HUMAN_PLAN, HumanPlanRequest(episode=key(index)))
        scenario, index = decode(HumanPlanReply, encode(plan)).scenario, index + 1
    run = bus.request(topics.ROBOT_PLAN, RobotPlanRequest(scenario=scenario, motions=animate(scenario)))
    again = decode(RobotPlanReply, encode(run))
    assert again.episode == scenario.episode
    assert np.array_equal(again.trajectory.actions, run.trajectory.actions)


def test_picture_shows_map_ways_and_outcome(bus, robot_planner):
    scenario = bus.request(topics.HUMAN_PLAN, HumanPlanRequest(episode=key(1))).scenario
    motions = animate(scenario)
    run = bus.request(topics.ROBOT_PLAN, RobotPlanRequest(scenario=scenario, motions=motions)).trajectory
    plain = draw_episode(robot_planner.maps.robot, scenario)
    full = draw_episode(robot_planner.maps.robot, scenario, run, motions=motions)
    assert full.dtype == np.uint8
    assert full.ndim == 3
    assert min(full.shape[:2]) > 100
    assert len(np.unique(full.reshape(-1, 3), axis=0)) > 5
    assert plain.shape != full.shape or not np.array_equal(plain, full)


@pytest.mark.parametrize("config", [ExpertConfig(range_m=7.0), HumanPlannerConfig(effort="quick")])
def test_configs_travel_as_mappings(config):
    assert section_from_mapping(type(config), section_to_mapping(config)) == config


def test_nonsense_in_the_human_planners_config_is_refused():
    with pytest.raises(ValueError, match="crossing"):
        FamilyMix(crossing=-0.5)
    with pytest.raises(ValueError, match="spacing"):
        HumanPlannerConfig(spacing="far")
