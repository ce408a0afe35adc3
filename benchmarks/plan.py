"""Success of the expert and cost of planning: `python benchmarks/plan.py [SCENE_OR_MAP ...] [--episodes N]`.

A scene is "embedded", a scene bundle, or a ROS map (.yaml). Prints one JSON object per scene and task. Times are CPU
time of the thread; compiled code is warmed up by the first episode, which does not count.
"""

import argparse
import json
import math
import sys
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from apps.scene_argument import open_scene
from common.avatars import load_avatars
from common.episode import EpisodeConfig, EpisodeResult, shortest_way_m, summarize
from common.maps import FloorMap, load_ros_map
from common.messages import (
    AnimateRequest,
    EpisodeKey,
    EpisodeMotions,
    HumanPlanRequest,
    Outcome,
    RobotPlanRequest,
    RobotTrajectory,
    Scenario,
    Split,
)
from common.robot import RobotConfig
from services.animator import Animator, AnimatorConfig, handle_animate
from services.planner import ExpertConfig, HumanPlannerConfig, Planner, handle_human_plan, handle_robot_plan
from services.planner.picture import draw_episode


class FlatMaps:
    """The maps of a ROS map on a flat floor."""

    def __init__(self, path: Path) -> None:
        self.robot = self.human = load_ros_map(path)
        self.floor = FloorMap(frame=self.robot.frame, height_m=np.zeros(self.robot.occupied.shape, np.float32))


def open_maps(name: str) -> Any:
    """Maps of a scene or of a ROS map."""
    return FlatMaps(Path(name)) if name.endswith(".yaml") else open_scene(name).maps


def failure(scenario: Scenario, motions: EpisodeMotions, trajectory: RobotTrajectory) -> str:
    """How an episode failed: for human collisions also where the human was and whether the robot moved."""
    if trajectory.outcome is not Outcome.HUMAN_COLLISION:
        return trajectory.outcome.value
    step = len(trajectory.xyyaw) - 1
    x, y, yaw = trajectory.xyyaw[-1]
    roots = np.array([human.motion.root_m[human.motion.row(step), :2] for human in motions.humans]) - (x, y)
    dx, dy = roots[int(np.argmin((roots**2).sum(axis=1)))]
    bearing = (math.atan2(dy, dx) - yaw + math.pi) % (2 * math.pi) - math.pi
    place = "in view" if abs(bearing) <= math.radians(50) else "out of view"
    return f"human {place}, robot {'standing' if trajectory.actions[-1, 0] < 0.1 else 'moving'}"


def measure(
    maps: Any, count: int, expert: ExpertConfig, *, seed: int, static: bool, pictures: Path | None
) -> dict[str, Any]:
    """Run the first `count` accepted test episodes."""
    avatars = load_avatars()
    robot, config = RobotConfig(), EpisodeConfig()
    planner = Planner(maps, avatars, robot, config, HumanPlannerConfig(), expert)
    animator = Animator(avatars, maps.floor, AnimatorConfig())
    results, speeds, replans_ms, human_ms, robot_ms = [], [], [], [], []
    failures, rejected, encounters = Counter[str](), Counter[str](), Counter[str]()
    index = 0
    while len(results) < count:
        episode = EpisodeKey(seed=seed, split=Split.TEST, index=index)
        index += 1
        started = time.thread_time()
        plan = handle_human_plan(planner, HumanPlanRequest(episode=episode, static=static))
        human_ms.append(1e3 * (time.thread_time() - started))
        if plan.scenario is None:
            rejected[plan.rejected] += 1
            continue
        motions = handle_animate(animator, AnimateRequest(scenario=plan.scenario)).motions
        if motions is None:
            rejected["motion"] += 1
            continue
        started = time.thread_time()
        run = handle_robot_plan(planner, RobotPlanRequest(scenario=plan.scenario, motions=motions)).trajectory
        robot_ms.append(1e3 * (time.thread_time() - started))
        assert run is not None
        goal, start = plan.scenario.goal_xy_m.tolist(), plan.scenario.start_xyyaw.tolist()[:2]
        shortest = shortest_way_m(
            maps.robot, robot.radius_m, tuple(start), tuple(goal), goal_radius_m=config.success_radius_m
        )
        results.append(EpisodeResult.from_trajectory(run, shortest))
        encounters.update(human.encounter for human in plan.scenario.humans)
        if len(results) > 1:
            replans_ms += [1e3 * t for t in run.replan_times_s]
        if run.outcome is Outcome.SUCCESS:
            speeds.append(float(run.actions[20:, 0].mean()) if len(run.actions) > 20 else math.nan)
        else:
            failures[failure(plan.scenario, motions, run)] += 1
        if pictures is not None:
            save(pictures / f"{episode.episode_id}_{run.outcome.value}.png", maps.robot, plan.scenario, run, motions)
    return {
        **{key: round(value, 4) for key, value in asdict(summarize(results, time_limit_s=50.0)).items()},
        "failures": dict(failures),
        "rejected": dict(rejected),
        "encounters": dict(encounters),
        "speed_after_1s_mps": round(float(np.nanmean(speeds)), 3),
        "replan_p50_ms": round(float(np.percentile(replans_ms, 50)), 3),
        "replan_p99_ms": round(float(np.percentile(replans_ms, 99)), 3),
        "human_plan_ms_per_accepted": round(sum(human_ms[1:]) / count, 1),
        "robot_plan_ms": round(float(np.mean(robot_ms[1:])), 1),
    }


def save(path: Path, robot_map: Any, scenario: Scenario, run: RobotTrajectory, motions: EpisodeMotions) -> None:
    """Write the picture of an episode."""
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), draw_episode(robot_map, scenario, run, motions=motions)[:, :, ::-1])


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=["embedded"])
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--pictures", type=Path, help="folder for a picture of every dynamic episode")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--foresight-s", type=float, default=0.0, help="see ExpertConfig")
    arguments = parser.parse_args()
    expert = ExpertConfig(foresight_s=arguments.foresight_s)
    for scene in arguments.scenes:
        maps = open_maps(scene)
        for static in (True, False):
            pictures = None if static else arguments.pictures
            numbers = measure(maps, arguments.episodes, expert, seed=arguments.seed, static=static, pictures=pictures)
            print(json.dumps({"scene": Path(scene).stem, "task": "static" if static else "dynamic", **numbers}))


if __name__ == "__main__":
    main()
