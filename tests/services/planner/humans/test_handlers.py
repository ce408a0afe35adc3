import numpy as np
import pytest

from readygo.common.errors import ConfigError
from readygo.common.messages import HumanPlanRequest, encode
from readygo.services.planner import HumanPlannerConfig, handle_human_plan
from tests.services.planner.worlds import key, make_human_planner, planner_of


def test_reactive_humans_without_an_expert_are_refused():
    with pytest.raises(ConfigError, match="Reactive humans yield to an expert"):
        make_human_planner(config=HumanPlannerConfig(reactive=True))


def test_expert_is_asked_for_only_where_somebody_reacts():
    asked = []

    def make_expert(scenario, motions):
        asked.append(scenario.episode.index)
        raise LookupError

    quiet = make_human_planner(make_expert=make_expert)
    request = HumanPlanRequest(episode=key(1))
    assert handle_human_plan(quiet, request).scenario is not None
    assert asked == []
    reacting = make_human_planner(config=HumanPlannerConfig(reactive=True), make_expert=make_expert)
    with pytest.raises(LookupError):
        handle_human_plan(reacting, request)
    assert asked == [1]
    assert handle_human_plan(reacting, HumanPlanRequest(episode=key(1), static=True)).scenario.humans == ()


def test_rejected_draw_has_a_reason_and_no_scenario():
    reply = handle_human_plan(planner_of("doorway", slope_max=0.0, effort="quick"), HumanPlanRequest(episode=key(3)))
    assert (reply.scenario is None) == bool(reply.rejected)


def test_nobody_walks_in_a_share_of_the_episodes_and_all_others_stay_what_they_are():
    requests = [HumanPlanRequest(episode=key(index)) for index in range(12)]
    everybody = [handle_human_plan(make_human_planner(), request).scenario for request in requests]
    absent = make_human_planner(config=HumanPlannerConfig(absent=0.5))
    scenarios = [handle_human_plan(absent, request).scenario for request in requests]
    empty = 0
    for scenario, other in zip(scenarios, everybody, strict=True):
        if scenario.humans == () and other is not None:
            empty += 1
            assert np.array_equal(scenario.start_xyyaw, other.start_xyyaw)
            assert np.array_equal(scenario.goal_xy_m, other.goal_xy_m)
        elif scenario.humans:
            assert encode(scenario) == encode(other)
    assert 2 <= empty <= 10
    with pytest.raises(ValueError, match=r"absent must be 0\.\.1, got 1\.5"):
        HumanPlannerConfig(absent=1.5)


def test_nobody_walks_in_the_first_episodes_and_all_others_stay_what_they_are():
    requests = [HumanPlanRequest(episode=key(index)) for index in range(8)]
    everybody = [handle_human_plan(make_human_planner(), request).scenario for request in requests]
    later = make_human_planner(config=HumanPlannerConfig(absent_first=4))
    scenarios = [handle_human_plan(later, request).scenario for request in requests]
    assert all(scenario is not None and scenario.humans == () for scenario in scenarios[:4])
    assert [encode(scenario) for scenario in scenarios[4:]] == [encode(scenario) for scenario in everybody[4:]]
    assert any(scenario is not None and scenario.humans for scenario in scenarios[4:])
    with pytest.raises(ValueError, match="absent_first must be at least 0, got -1"):
        HumanPlannerConfig(absent_first=-1)


def test_each_human_yields_by_a_probability_and_those_who_stand_never_do():
    some = make_human_planner(config=HumanPlannerConfig(yielding=0.3, standing_min=1, standing_max=1))
    everybody = make_human_planner(config=HumanPlannerConfig(standing_min=1, standing_max=1))
    drawn, standing = [], []
    for index in range(60):
        scenario = handle_human_plan(some, HumanPlanRequest(episode=key(index))).scenario
        if scenario is None:
            continue
        yields = some.reacts(scenario)
        assert some.reacts(scenario) == yields, "drawn by the episode"
        stands = [human.encounter == "standing" for human in scenario.humans]
        assert everybody.reacts(scenario) == [not one for one in stands]
        drawn += [one for one, still in zip(yields, stands, strict=True) if not still]
        standing += [one for one, still in zip(yields, stands, strict=True) if still]
    assert not any(standing)
    assert 0.15 < np.mean(drawn) < 0.45
