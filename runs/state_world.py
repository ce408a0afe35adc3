"""The world of a run for the state simulation and for drivers that are told states."""

from readygo.common.state_policy.state_driver import StateDriver
from readygo.common.state_policy.state_policy import StatePolicy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.world import ObservationConfig, StateWorld, make_world
from readygo.runs.config import RunConfig
from readygo.runs.world import World
from readygo.services.planner import PlanningMaps


def state_world(world: World, observation: ObservationConfig) -> StateWorld:
    """The world of a run for the state simulation.

    Raises:
        ConfigError: If its robot has ranges.
    """
    return state_world_of(world.scene.maps, world.config, observation)


def state_world_of(maps: PlanningMaps, config: RunConfig, observation: ObservationConfig) -> StateWorld:
    """The world of some maps; arguments and errors as for `state_world`."""
    return make_world(maps.robot, maps.sight, config.robot, config.episode, observation)


def goal_distances(world: World) -> GoalDistances:
    """Remaining distances on the robot's map of a run."""
    return GoalDistances(world.scene.maps.robot, world.config.robot.planning_radius_m)


def state_driver(world: World, policy: StatePolicy) -> StateDriver:
    """A driver by a state policy in the world of a run.

    Raises:
        ConfigError: If its robot has ranges.
    """
    return StateDriver(policy, state_world(world, policy.spec.observation), goal_distances(world))
