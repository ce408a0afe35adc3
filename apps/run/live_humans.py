"""Episodes whose humans make way for whoever drives, instead of following motions that were planned before."""

from collections.abc import Callable

from readygo.apps.run.world import World
from readygo.common.episode import EpisodeSimulation
from readygo.services.animator.retime import RetimedWalk
from readygo.services.evaluator import MatchedEpisode, Task
from readygo.services.planner import HumanPlanner
from readygo.services.planner.humans.reactive import ReactiveHumans, ReactiveSimulation


def live_simulations(world: World, planner: HumanPlanner) -> Callable[[MatchedEpisode], EpisodeSimulation]:
    """Starts the episodes of an evaluation.

    Args:
        world: The place.
        planner: Where its humans mean to walk.

    Returns:
        Makes a simulation of an episode: its humans look at the robot where its task or the settings say so.
    """
    config, maps = world.config, world.scene.maps

    def simulate(episode: MatchedEpisode) -> EpisodeSimulation:
        scenario = episode.scenario
        reacts = episode.task is Task.REACTIVE or config.human_planner.reactive
        if not (reacts and scenario.humans):
            return EpisodeSimulation(scenario, episode.motions, maps.robot, config.robot, config.episode)
        humans = ReactiveHumans(
            [human.xy_m for human in scenario.humans],
            planner.reacts(scenario),
            planner.human_map,
            config.robot.radius_m + config.episode.human_radius_m,
            config.episode,
            config.human_planner,
        )
        figures = [RetimedWalk(human.motion, maps.floor) for human in episode.motions.humans]
        return ReactiveSimulation(
            scenario, humans, maps.robot, config.robot, config.episode, animated=(episode.motions, figures)
        )

    return simulate
