import pytest

from readygo.common.episode import Purpose, episode_rng
from readygo.common.messages import HumanPlanRequest
from readygo.services.planner import handle_human_plan
from readygo.services.planner.humans.families import FAMILIES
from tests.services.planner.worlds import key, planner_of


@pytest.fixture(scope="package")
def drawn():
    """By family: (scenario, the robot's way) of the first indices that have one."""
    found = {}
    for family in FAMILIES:
        # Three: a group of two would leave one over who finds no group.
        planner = planner_of(family, people=(3, 3) if family == "standing_group" else (1, 1))
        rows = []
        for index in range(24):
            scenario = handle_human_plan(planner, HumanPlanRequest(episode=key(index))).scenario
            if scenario is not None:
                task = planner.sampler.draw_task(episode_rng(key(index), Purpose.SCENARIO))
                rows.append((scenario, task.way_m))
        found[family] = rows[:8]
    return found
