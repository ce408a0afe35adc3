"""The world of a run for the state simulation and for drivers that are told states."""

from readygo.common.maps import sight_of_occupancy
from readygo.common.state_policy.state_driver import StateDriver
from readygo.common.state_policy.state_policy import StatePolicy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.world import ObservationConfig, StateWorld, make_world
from readygo.runs.world import World


def state_world(world: World, observation: ObservationConfig) -> StateWorld:
    """The world of a run for the state simulation.

    Raises:
        ConfigError: If its robot has ranges.
    """
    maps = world.scene.maps
    sight = maps.sight if maps.sight is not None else sight_of_occupancy(maps.robot)
    return make_world(maps.robot, sight, world.config.robot, world.config.episode, observation)


def goal_distances(world: World) -> GoalDistances:
    """Remaining distances on the robot's map of a run."""
    return GoalDistances(world.scene.maps.robot, world.config.robot.planning_radius_m)


def state_driver(world: World, policy: StatePolicy) -> StateDriver:
    """A driver by a state policy in the world of a run.

    Raises:
        ConfigError: If its robot has ranges.
    """
    return StateDriver(policy, state_world(world, policy.spec.observation), goal_distances(world))
