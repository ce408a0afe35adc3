"""Episodes of the embedded scene in both simulations."""

import itertools
from dataclasses import dataclass

import numpy as np

from readygo.common.episode import EpisodeSimulation
from readygo.common.messages import AnimateRequest, EpisodeKey, EpisodeMotions, HumanPlanRequest, Scenario, Split
from readygo.common.state_simulation.bank import EpisodeBank, make_bank
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.world import ObservationConfig, StateWorld
from readygo.runs.config import RunConfig
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.runs.state_world import goal_distances, state_world
from readygo.runs.world import World
from readygo.services.animator import handle_animate
from readygo.services.planner import handle_human_plan


@dataclass(frozen=True, eq=False)
class Drawn:
    """Some episodes, and the world that they are in."""

    world: World
    pairs: list[tuple[Scenario, EpisodeMotions]]
    state_world: StateWorld
    bank: EpisodeBank
    distances: GoalDistances

    def simulation(self, k: int) -> EpisodeSimulation:
        """An episode in the simulation that data are recorded in."""
        config = self.world.config
        return EpisodeSimulation(*self.pairs[k], self.world.scene.maps.robot, config.robot, config.episode)


def draw(count: int, split: Split = Split.TEST) -> Drawn:
    """The first accepted episodes of a split."""
    world = World(make_spec(open_scene("embedded"), None, RunConfig(), seed=0, split=split, static=False))
    planner, animator = world.human_planner(), world.animator()

    def accepted():
        for index in itertools.count():
            key = EpisodeKey(seed=0, split=split, index=index)
            scenario = handle_human_plan(planner, HumanPlanRequest(episode=key)).scenario
            motions = handle_animate(animator, AnimateRequest(scenario=scenario)).motions if scenario else None
            if motions is not None:
                yield scenario, motions

    pairs = list(itertools.islice(accepted(), count))
    distances = goal_distances(world)
    bank = make_bank(pairs, distances, world.config.episode.human_count_max)
    return Drawn(world, pairs, state_world(world, ObservationConfig()), bank, distances)


def towards_path(told: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Commands along the shortest path with random ones in between, so that every outcome occurs."""
    bearing = np.arctan2(told[:, 42], told[:, 41])
    commands = np.stack([np.where(np.abs(bearing) < 0.7, 0.8, 0.1), np.clip(2.0 * bearing, -1.2, 1.2)], axis=1)
    other = rng.random(len(told)) < 0.15
    commands[other] = rng.uniform((-0.5, -2.0), (1.5, 2.0), (len(told), 2))[other]
    return commands
