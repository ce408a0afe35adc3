"""The scenario mix that success rates are compared on is frozen: experts are tuned, it is not."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.messages import HumanPlanRequest, encode
from readygo.services.planner import HumanPlannerConfig, handle_human_plan
from readygo.services.planner.humans.mixes import MIXES
from tests.services.planner.worlds import key, make_human_planner

GOLDEN = Path(__file__).parents[3] / "golden" / "scenario_mix_paper.json"
COUNT = 20


def _described(reply):
    """Start, goal and, per human, encounter, speed, rows, first, middle and last position [m]."""
    if reply.scenario is None:
        return {"rejected": reply.rejected}
    return {
        "start": reply.scenario.start_xyyaw.tolist(),
        "goal": reply.scenario.goal_xy_m.tolist(),
        "humans": [
            {
                "encounter": human.encounter,
                "speed": human.speed_mps,
                "xy": human.xy_m[[0, len(human.xy_m) // 2, -1]].ravel().tolist(),
            }
            for human in reply.scenario.humans
        ],
    }


def test_the_papers_mix_is_the_frozen_one(human_planner, request):
    drawn = [
        _described(handle_human_plan(human_planner, HumanPlanRequest(episode=key(index, seed=2))))
        for index in range(COUNT)
    ]
    if request.config.getoption("--update-golden"):
        GOLDEN.write_text("[\n" + ",\n".join(json.dumps(row) for row in drawn) + "\n]\n")
    frozen = json.loads(GOLDEN.read_text())
    assert len(frozen) == COUNT
    for now, then in zip(drawn, frozen, strict=True):
        assert now.keys() == then.keys()
        if "rejected" in then:
            assert now == then
            continue
        assert now["start"] == pytest.approx(then["start"], abs=1e-3)
        assert now["goal"] == pytest.approx(then["goal"], abs=1e-3)
        assert [human["encounter"] for human in now["humans"]] == [human["encounter"] for human in then["humans"]]
        for a, b in zip(now["humans"], then["humans"], strict=True):
            assert a["speed"] == pytest.approx(b["speed"], abs=1e-3)
            assert np.allclose(a["xy"], b["xy"], atol=1e-3)


@pytest.mark.parametrize("name", MIXES)
def test_recipes_give_the_same_bytes_on_any_planner_and_keep_other_settings(name):
    episode, config = MIXES[name](EpisodeConfig(time_limit_s=33.0), HumanPlannerConfig(absent=0.12))
    assert episode.time_limit_s == 33.0
    assert config.absent == 0.12
    one, other = (
        dataclasses.replace(config, mix=dataclasses.replace(config.mix)) if again else config for again in (0, 1)
    )
    replies = []
    for human_config in (one, other):
        planner = make_human_planner(avatar_names=("zoe", "adam"), episode=episode, config=human_config)
        order = (1, 0, 2) if human_config is one else (2, 1, 0)
        drawn = {k: encode(handle_human_plan(planner, HumanPlanRequest(episode=key(k)))) for k in order}
        replies.append([drawn[k] for k in range(3)])
    assert replies[0] == replies[1]
