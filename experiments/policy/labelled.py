"""What a sample with the expert's advice costs: picture, expert, risks and policy, in thread CPU time.

    python -m experiments.policy.labelled embedded [--policy FOLDER] [--episodes 5]

Without a policy an untrained one of the paper's size drives.
"""

import argparse
import itertools
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from readygo.common.messages import Split
from readygo.common.policy import Policy, PolicySpec, load_policy
from readygo.common.policy.driver import PolicyDriver
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig
from readygo.runs.scenarios import accepted_scenarios
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.runs.world import World
from readygo.services.driver import RiskMap, drive
from readygo.services.renderer import LiveCamera
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.model import PolicyNet


class Clock:
    """CPU time by part."""

    def __init__(self) -> None:
        self.spent_s: dict[str, float] = {}

    def watch(self, part: str, thing: Any, method: str) -> None:
        """Count what a method of an object takes."""
        called: Callable[..., Any] = getattr(thing, method)

        def timed(*arguments: Any) -> Any:
            begin_s = time.thread_time()
            try:
                return called(*arguments)
            finally:
                self.spent_s[part] = self.spent_s.get(part, 0.0) + time.thread_time() - begin_s

        setattr(thing, method, timed)


def untrained_policy() -> Policy:
    """A policy of the paper's size that learned nothing."""
    torch.manual_seed(0)
    robot = RobotConfig()
    with tempfile.TemporaryDirectory() as folder:
        export_policy(PolicyNet(robot, NetworkConfig()).eval(), PolicySpec(robot=robot), Path(folder))
        return load_policy(folder)


def measure(world: World, policy: Policy, episodes: int) -> dict[str, Any]:
    """Milliseconds a sample, by part; the first episode, which loads compiled code, is not counted."""
    humans, animator, renderer, planner = world.human_planner(), world.animator(), world.renderer(), world.robot_planner
    clock, samples, driven, weigher = Clock(), 0, -1, RiskMap(planner.maps.robot)
    clock.watch("risks", weigher, "risks")
    for scenario, motions in accepted_scenarios(
        humans, animator, world.spec.seed, world.spec.split, itertools.count(), static=world.spec.static
    ):
        simulation, expert = planner.simulation(scenario, motions), planner.expert(scenario, motions)
        camera = LiveCamera(renderer)
        driver = PolicyDriver(policy, camera, simulation.clock.control_every)
        for part, thing, method in (
            ("picture", camera, "step"),
            ("expert", expert, "act"),
            ("policy", driver, "act"),
        ):
            clock.watch(part, thing, method)
        length = len(drive(simulation, expert, weigher, driver, camera=camera).expert_commands)
        samples, driven = (0, 0) if driven < 0 else (samples + length, driven + 1)
        if samples == 0:
            clock.spent_s.clear()
        if driven == episodes:
            break
    return {"samples": samples, **{f"{part}_ms": 1e3 * s / samples for part, s in clock.spent_s.items()}}


def main() -> None:
    """Measure, with and without humans."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--policy", type=Path)
    parser.add_argument("--episodes", type=int, default=5)
    arguments = parser.parse_args()
    policy = load_policy(arguments.policy) if arguments.policy else untrained_policy()
    config = RunConfig(robot=policy.spec.robot)
    for static in (True, False):
        spec = make_spec(open_scene(arguments.scene), None, config, seed=0, split=Split.TRAIN, static=static)
        print(json.dumps({"static": static, **measure(World(spec), policy, arguments.episodes)}))


if __name__ == "__main__":
    main()
