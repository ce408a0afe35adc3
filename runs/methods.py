"""Methods of an evaluation by name: experts, baselines, networks and a user's methods."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from readygo.common.config import section_differences
from readygo.common.episode.loop import Driver
from readygo.common.errors import PolicyError
from readygo.common.maps.occupancy import GROUND_CLEARANCE_M
from readygo.common.maps.ros_map import load_unknown_cells
from readygo.common.messages import TeacherKind
from readygo.common.perception import Perception, load_perception
from readygo.common.perception.noise import PERCEIVED
from readygo.common.policy import check_policy_camera, check_policy_limits, load_policy
from readygo.common.policy.artifact import SPEC_FILE
from readygo.common.policy.driver import PolicyDriver
from readygo.common.scenes.scene import ROBOT_MAP_FILE
from readygo.common.state_policy.actor import tracker_for
from readygo.common.state_policy.perceiving_driver import PerceivingStateDriver
from readygo.common.state_policy.robots import robot_difference
from readygo.common.state_policy.state_policy import StatePolicy, is_state_policy, load_state_policy
from readygo.runs.state_world import goal_distances, state_driver, state_world
from readygo.runs.world import World
from readygo.services.evaluator import (
    EXPERT,
    POLICY,
    STRAIGHT_LINE,
    DiscretePlannerDriver,
    Evaluator,
    MakeDriver,
    SocialForceDriver,
    SplatMap,
    SplatNavDriver,
    load_custom_method,
)
from readygo.services.planner import ExpertDriver, PerceivingDriver, RobotPlanner, expert_recipe

CHECKPOINTS = Path("checkpoints")
VID2SIM, RL = "vid2sim", "rl"
PERCEIVE_AND_PLAN = "perceive-and-plan"
"""The expert on the map that it knows, among the people that a network sees in the robot's images."""
PERCEIVE_AND_ACT = "perceive-and-act"
"""The state policy `rl` among the people that this network sees."""
PERCEPTION = "perception"
"""Folder of the network that perceives, in the folder of weights and policies."""
EXPERT_TRACKED = TeacherKind.EXPERT_TRACKED.value
"""The expert that knows people by tracks of what a network would tell of those in view."""
EXPERT_KINDS = {"expert-paper": "paper", "expert-oracle": "oracle", "expert-blind": "blind"}
"""Experts of other recipes: the paper's, one that knows where all people walk, and one that sees none."""
BLIND = (EXPERT, EXPERT_TRACKED, *EXPERT_KINDS, STRAIGHT_LINE, "social-force", "gaussnav", "splat-nav")
"""Methods that need no images."""
NETWORKS = {"gnm": "gnm_large.pth", "vint": "vint.pth", "nomad": "nomad.pth"}
"""Published networks, with their authors' names of the weight files."""


def needs_renderer(methods: Sequence[str], checkpoints: Path = CHECKPOINTS) -> bool:
    """True if one of the methods uses camera images.

    Args:
        methods: Names of methods.
        checkpoints: Folder of weights and policies.
    """
    blind = {*BLIND, RL, *state_policies(methods, checkpoints)}
    return any(method not in blind for method in methods)


def network_of(method: str) -> str:
    """The published network that a method is; empty if it is none.

    Args:
        method: Name of a method: `gnm`, or `gnm/fine-tuned` for the weights in a folder of that name.
    """
    name = method.partition("/")[0]
    return name if name in NETWORKS and ":" not in method else ""


def network_file(method: str, checkpoints: Path) -> Path:
    """The weights of a method that is a published network.

    Args:
        method: Name of the method, see `network_of`.
        checkpoints: Folder of weights and policies.
    """
    name, _, folder = method.partition("/")
    return (checkpoints / method if folder else checkpoints) / NETWORKS[name]


def state_policies(methods: Sequence[str], checkpoints: Path) -> dict[str, Path]:
    """Folders of the methods that are state policies, from `readygo rl`, by their names in `checkpoints`.

    Args:
        methods: Names of methods of any kind.
        checkpoints: Folder of policies.
    """
    names = [name for name in methods if _may_be_policy(name)]
    return {name: checkpoints / name for name in names if is_state_policy(checkpoints / name)}


def other_policies(methods: Sequence[str], checkpoints: Path) -> dict[str, Path]:
    """Folders of the methods that are further policies, by their names in `checkpoints`.

    Args:
        methods: Names of methods of any kind.
        checkpoints: Folder of policies, or of runs of `readygo learn` with a policy.
    """
    found: dict[str, Path] = {}
    for name in methods:
        if not _may_be_policy(name):
            continue
        places = [place for place in (checkpoints / name, checkpoints / name / "policy") if _is_policy(place)]
        found |= {name: places[0]} if places else {}
    return found


def _may_be_policy(name: str) -> bool:
    return name not in (*BLIND, POLICY) and not network_of(name) and ":" not in name


def _is_policy(folder: Path) -> bool:
    return (folder / SPEC_FILE).is_file()


def named_methods(
    world: World, methods: Sequence[str] = (), checkpoints: Path = CHECKPOINTS, hold_steps: int = 1
) -> dict[str, MakeDriver]:
    """The methods of an evaluation, besides the policy and the straight line, as functions that load them.

    Args:
        world: World of the evaluation.
        methods: Names of requested methods; a user's methods are named `my_package:MyDriver`.
        checkpoints: Folder of weights and policies.
        hold_steps: Steps from one decision of a policy to the next.
    """
    policies = other_policies((VID2SIM, *methods), checkpoints)
    known: dict[str, MakeDriver] = {
        EXPERT: lambda _: ExpertDriver(world.robot_planner.expert),
        **{name: _expert(world, kind) for name, kind in EXPERT_KINDS.items()},
        "social-force": lambda _: SocialForceDriver(),
        "gaussnav": lambda _: DiscretePlannerDriver(),
        "splat-nav": lambda _: SplatNavDriver(_splat_map(world)),
        EXPERT_TRACKED: lambda _: ExpertDriver(
            lambda scenario, _: world.robot_planner.detecting_expert(scenario, PERCEIVED)
        ),
        PERCEIVE_AND_PLAN: lambda evaluator: _perceiving(world, checkpoints / PERCEPTION, evaluator),
        PERCEIVE_AND_ACT: lambda evaluator: _acting(world, checkpoints, evaluator),
        VID2SIM: lambda _: _no_mesh_policy(checkpoints / VID2SIM),
        RL: lambda _: _raise(_no_state_policy(RL, checkpoints / RL)),
        **{
            name: _state_policy(name, folder, world)
            for name, folder in state_policies((RL, *methods), checkpoints).items()
        },
        **{name: _policy(name, folder, hold_steps) for name, folder in policies.items()},
        **{
            name: _network(network_of(name), network_file(name, checkpoints))
            for name in (*NETWORKS, *methods)
            if network_of(name)
        },
    }
    return known | {name: _custom(name) for name in methods if ":" in name}


def _custom(name: str) -> MakeDriver:
    return lambda evaluator: load_custom_method(name, evaluator)


def _splat_map(world: World) -> SplatMap:
    maps = world.scene.maps
    unknown = load_unknown_cells(maps.folder / ROBOT_MAP_FILE)
    return SplatMap(
        world.scene.cloud, maps.floor, maps.robot.frame, unknown, world.config.robot.widest, GROUND_CLEARANCE_M
    )


def _expert(world: World, kind: str) -> MakeDriver:
    """The driver of an expert that differs from the world's by what its recipe changes."""
    config, recipe = world.config, expert_recipe(kind)
    changes = {name: value for name, _, value in section_differences(expert_recipe("spacetime"), recipe)}
    expert = dataclasses.replace(config.expert, **changes)
    return lambda _: ExpertDriver(
        RobotPlanner(world.scene.maps, world.avatars, config.robot, config.episode, expert).expert
    )


def _perceiving(world: World, folder: Path, evaluator: Evaluator) -> Driver[Any]:
    perception, planner = _load_perception(PERCEIVE_AND_PLAN, folder, evaluator), world.robot_planner
    return PerceivingDriver(perception, evaluator.eyes(), lambda episode: planner.tracked_expert(episode.scenario))


def _acting(world: World, checkpoints: Path, evaluator: Evaluator) -> Driver[Any]:
    if not is_state_policy(checkpoints / RL):
        raise _no_state_policy(PERCEIVE_AND_ACT, checkpoints / RL)
    policy = _load_state_policy(PERCEIVE_AND_ACT, checkpoints / RL, evaluator)
    perception = _load_perception(PERCEIVE_AND_ACT, checkpoints / PERCEPTION, evaluator)
    ground = world.robot_planner.ground
    return PerceivingStateDriver(
        policy,
        perception,
        evaluator.eyes(),
        state_world(world, policy.spec.observation),
        goal_distances(world),
        lambda: tracker_for(policy, ground.human_clearance, ground.human_frame),
    )


def _load_perception(name: str, folder: Path, evaluator: Evaluator) -> Perception:
    try:
        return load_perception(folder, robot=evaluator.robot)
    except PolicyError as error:
        raise PolicyError(f"The method {name}: {error}") from error


def _no_mesh_policy(folder: Path) -> Driver[Any]:
    """Raise PolicyError: there is no policy that was trained with a game engine's human meshes."""
    raise PolicyError(
        f"The method {VID2SIM} needs a policy that learned among mesh-like people, at {folder}: record and train "
        'with [renderer] human_look = "mesh" (readygo learn SCENE --config mesh.toml), and copy RUN/policy there.'
    )


def _no_state_policy(name: str, folder: Path) -> PolicyError:
    return PolicyError(f"The method {name} needs a policy at {folder}: readygo rl SCENE --out {folder}.")


def _raise(error: PolicyError) -> Driver[Any]:
    raise error


def _state_policy(name: str, folder: Path, world: World) -> MakeDriver:
    """The driver of a state policy: it is told its map, its pose, and simulated detections of pedestrians."""

    def make(evaluator: Evaluator) -> Driver[Any]:
        return state_driver(world, _load_state_policy(name, folder, evaluator))

    return make


def _load_state_policy(name: str, folder: Path, evaluator: Evaluator) -> StatePolicy:
    policy = load_state_policy(folder)
    if difference := robot_difference(policy.spec.robot, evaluator.robot):
        raise PolicyError(
            f"The method {name} was trained for another robot ({difference}): name its robot with --robot."
        )
    return policy


def _policy(name: str, folder: Path, hold_steps: int) -> MakeDriver:
    def make(evaluator: Evaluator) -> Driver[Any]:
        try:
            policy = load_policy(folder)
            check_policy_limits(policy.spec, evaluator.robot)
            if evaluator.camera == "policy":
                check_policy_camera(policy.spec, evaluator.robot)
        except PolicyError as error:
            raise PolicyError(f"The method {name}: {error}") from error
        return PolicyDriver(policy, evaluator.eyes(policy.spec.images), hold_steps)

    return make


def _network(name: str, path: Path) -> MakeDriver:
    def make(evaluator: Evaluator) -> Driver[Any]:
        from readygo.services.evaluator import NetworkDriver

        return NetworkDriver.load(name, path, evaluator)

    return make
