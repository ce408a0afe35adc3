"""Policies on a robot that they need not know: in the same episodes, beside the expert and a straight line.

    readygo learn embedded --robot examples/robots/several.toml --samples 200000 --out several
    readygo learn embedded --samples 200000 --out one
    python -m experiments.policy.robots embedded --robot examples/robots/one_of_several.toml --policies
        several=several/policy one=one/policy --episodes 50 --out FOLDER --json FILE

`readygo evaluate` refuses a robot that a policy did not learn; here such a policy sees through that robot's camera all
the same, and the robot cuts off what it cannot do of its commands. Episodes are kept in FOLDER as they end; the same
command resumes, with more policies as well.
"""

import argparse
import dataclasses
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from readygo.benchmarks.rasterizer.render import machine
from readygo.common.config import section_to_mapping
from readygo.common.errors import ReadygoError
from readygo.common.files import write_whole
from readygo.common.messages import Split
from readygo.common.policy import load_policy
from readygo.common.policy.driver import PolicyDriver
from readygo.common.robot import RobotConfig, load_robot
from readygo.runs.evaluation import evaluation_settings, evaluation_world, make_evaluator, make_request, tables
from readygo.runs.methods import named_methods
from readygo.runs.origin import avatars_of_policy, settings_of_policy
from readygo.runs.policy import policy_sha256
from readygo.services.evaluator import EXPERT, STRAIGHT_LINE, EpisodeRecord, MakeDriver, handle_evaluate
from readygo.services.evaluator.results import open_results

TASKS = ("static", "dynamic")


def compare(
    scene: str, robot: RobotConfig, policies: Mapping[str, Path], *, episodes: int, seed: int, out: Path
) -> dict[str, Any]:
    """Measures of the policies with intervals, and each beside the first one and the expert.

    Args:
        scene: Scene bundle, or "embedded".
        robot: Who drives.
        policies: Folders by what the table calls them; humans are those of the first one's data.
        episodes: Per task.
        seed: Seed of the episodes.
        out: Folder that keeps them.

    Raises:
        ReadygoError: If something cannot be used.
    """
    loaded = {name: load_policy(folder) for name, folder in policies.items()}
    first = next(iter(loaded.values())).spec
    config = dataclasses.replace(settings_of_policy(first), robot=robot)
    world = evaluation_world(scene, config, avatars=avatars_of_policy(first), seed=seed)
    drivers: dict[str, MakeDriver] = {
        name: lambda evaluator, policy=policy: PolicyDriver(policy, evaluator.eyes(policy.spec.images))  # type: ignore[misc]
        for name, policy in loaded.items()
    }
    request = make_request(episodes, TASKS, (*policies, EXPERT, STRAIGHT_LINE), Split.TEST, seed)
    hashes = {name: policy_sha256(folder) for name, folder in policies.items()}
    settings = evaluation_settings(world, request, policy="", camera="robot", methods=hashes)
    evaluator = make_evaluator(world, renderer=world.renderer(), methods=named_methods(world) | drivers)
    with open_results(out, settings) as results:
        reply = handle_evaluate(evaluator, request, report=_tell, results=results)
    return tables(reply, request, config.episode)


def _tell(record: EpisodeRecord) -> None:
    print(
        record.task.value, record.method, record.episode.index, record.result.outcome.value, file=sys.stderr, flush=True
    )


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--robot", type=Path, required=True)
    parser.add_argument("--policies", nargs="+", required=True, metavar="NAME=FOLDER")
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--note", default="")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    policies = {name: Path(folder) for name, _, folder in (item.partition("=") for item in asked.policies)}
    try:
        robot = load_robot(asked.robot)
        found = compare(asked.scene, robot, policies, episodes=asked.episodes, seed=asked.seed, out=asked.out)
    except ReadygoError as error:
        sys.exit(str(error))
    for task, methods in found["measures"].items():
        for method, scores in methods.items():
            print(json.dumps({"task": task, "method": method, "success": scores["success"]}))
    if asked.json is not None:
        command = f"python -m experiments.policy.robots {Path(asked.scene).name} --robot {asked.robot.name}"
        kept = {
            "machine": machine(),
            "command": command,
            "note": asked.note,
            "robot": section_to_mapping(robot),
            **found,
        }
        write_whole(asked.json, json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
