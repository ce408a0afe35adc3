"""Scenario files in pieces, and planners that play them."""

from readygo.common.messages import HumanPlanRequest
from readygo.services.planner import handle_human_plan
from readygo.services.planner.humans.scenario_file import parse_scenarios
from tests.services.planner.worlds import key, planner_of

HEAD = 'format = "readygo-scenarios/1"\n'
ENTRY = "[[scenarios]]\nstart_m = [-2.0, 4.0]\ngoal_m = [1.5, 5.0]\n"
HUMAN = "[[scenarios.humans]]\nwaypoints_m = [[2.0, 3.0], [-1.0, 6.0]]\n"


def playing(text, source="people.toml", **config):
    """A planner that plays the text of a scenario file in four rooms."""
    return planner_of(scenarios=parse_scenarios(text, source), **config)


def played(planner, index=0, **request):
    return handle_human_plan(planner, HumanPlanRequest(episode=key(index), **request)).scenario
