"""Episodes whose humans react to the robot, instead of following precomputed motions."""

from collections.abc import Callable

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.resample import at_rate
from readygo.common.episode.robot import robot_of_episode
from readygo.common.robot.kinematics import RATE_HZ
from readygo.runs.world import World
from readygo.services.animator import RetimedWalk
from readygo.services.evaluator import MatchedEpisode, Task
from readygo.services.planner import HumanPlanner, ReactiveHumans, ReactiveSimulation


def live_simulations(world: World, planner: HumanPlanner) -> Callable[[MatchedEpisode], EpisodeSimulation]:
    """A function that starts the episodes of an evaluation.

    Args:
        world: World of the evaluation.
        planner: Planner of the humans' paths.

    Returns:
        Function that makes the simulation of an episode; its humans react to the robot if task or settings say so.
    """
    config, maps = world.config, world.scene.maps

    def simulate(episode: MatchedEpisode) -> EpisodeSimulation:
        scenario = episode.scenario
        robot = robot_of_episode(config.robot, scenario.episode)
        reacts = episode.task is Task.REACTIVE or config.human_planner.reactive
        if not (reacts and scenario.humans):
            return EpisodeSimulation(scenario, episode.motions, maps.robot, robot, config.episode)
        humans = ReactiveHumans(
            [human.xy_m for human in scenario.humans],
            planner.reacts(scenario),
            planner.human_map,
            robot.radius_m + config.episode.human_radius_m,
            config.episode,
        )
        figures = [RetimedWalk(at_rate(human.motion, RATE_HZ), maps.floor) for human in episode.motions.humans]
        return ReactiveSimulation(
            scenario, humans, maps.robot, robot, config.episode, animated=(episode.motions, figures)
        )

    return simulate
