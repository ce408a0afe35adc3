"""What drawing scenarios costs and gives.

    python -m readygo.benchmarks.planning.scenarios [SCENE_OR_MAP ...] [--people varied]

A scene is "embedded", a scene bundle, or a ROS map (.yaml). Prints one JSON object per scene: CPU time of the thread a
drawn scenario, rejected ones included, how many people came and of which families, and with --drive how the expert did
among them. The first scenarios warm up.
"""

import argparse
import dataclasses
import json
import time
from collections import Counter
from pathlib import Path
from typing import Any

from readygo.common.avatars import load_avatars
from readygo.common.messages import AnimateRequest, EpisodeKey, HumanPlanRequest, Scenario, Split
from readygo.runs.config import load_run_config
from readygo.runs.scene_argument import open_maps
from readygo.services.animator import Animator, handle_animate
from readygo.services.planner import HumanPlanner, RobotPlanner, handle_human_plan
from readygo.services.planner.expert.handlers import drive
from readygo.services.planner.humans.mixes import MIXES, MixName

WARM_UP = 15


def measure(scene: str, people: MixName, count: int, seed: int, *, reactive: bool, drives: bool) -> dict[str, Any]:
    """Draw the first `count` scenarios of the test split."""
    config = load_run_config(None, people=people)
    human_config = dataclasses.replace(config.human_planner, reactive=reactive)
    maps, _ = open_maps(scene)
    avatars = load_avatars()
    animator = Animator(avatars, maps.floor, config.animator)
    expert = RobotPlanner(maps, avatars, config.robot, config.episode, config.expert)
    planner = HumanPlanner(
        maps,
        sorted(avatars),
        config.robot,
        config.episode,
        human_config,
        make_expert=expert.expert,
    )
    for index in range(WARM_UP):
        _draw(planner, seed + 1, index)
    started_s = time.thread_time()
    replies = [_draw(planner, seed, index) for index in range(count)]
    took_s = time.thread_time() - started_s
    scenarios = [reply.scenario for reply in replies if reply.scenario is not None]
    outcomes = Counter(_driven(expert, animator, scenario) for scenario in scenarios) if drives else Counter[str]()
    return {
        "scene": Path(scene).stem,
        "people": people,
        "reactive": reactive,
        "ms_per_scenario": round(1e3 * took_s / count, 1),
        "rejected": dict(Counter(reply.rejected for reply in replies if reply.rejected)),
        "humans": dict(sorted(Counter(len(scenario.humans) for scenario in scenarios).items())),
        "families": dict(Counter(human.encounter for s in scenarios for human in s.humans).most_common()),
        "outcomes": dict(outcomes),
    }


def _draw(planner: HumanPlanner, seed: int, index: int) -> Any:
    return handle_human_plan(planner, HumanPlanRequest(episode=EpisodeKey(seed=seed, split=Split.TEST, index=index)))


def _driven(planner: RobotPlanner, animator: Animator, scenario: Scenario) -> str:
    """How the expert's run ends among the animated people."""
    motions = handle_animate(animator, AnimateRequest(scenario=scenario)).motions
    return "no motion" if motions is None else drive(planner, scenario, motions).outcome.value


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=["embedded"])
    parser.add_argument("--people", choices=sorted(MIXES), default="varied")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--reactive", action="store_true", help="people yield to the expert's robot")
    parser.add_argument("--drive", action="store_true", help="let the expert drive among the people")
    arguments = parser.parse_args()
    for scene in arguments.scenes:
        numbers = measure(
            scene,
            arguments.people,
            arguments.episodes,
            arguments.seed,
            reactive=arguments.reactive,
            drives=arguments.drive,
        )
        print(json.dumps(numbers), flush=True)


if __name__ == "__main__":
    main()
