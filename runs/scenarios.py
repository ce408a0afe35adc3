"""The scenarios of a world that can be played."""

from collections.abc import Iterable, Iterator

from readygo.common.messages import AnimateRequest, EpisodeKey, EpisodeMotions, HumanPlanRequest, Scenario, Split
from readygo.services.animator import Animator, handle_animate
from readygo.services.planner import HumanPlanner, handle_human_plan


def accepted_scenarios(
    planner: HumanPlanner, animator: Animator, seed: int, split: Split, indices: Iterable[int], *, static: bool = False
) -> Iterator[tuple[Scenario, EpisodeMotions]]:
    """The scenarios that neither planner nor animator rejects, with the motions of their humans.

    Args:
        planner: Draws the scenarios.
        animator: Makes the motions.
        seed: Seed of the episodes.
        split: Split of the episodes.
        indices: Indices of the episodes, in the order in which they are drawn.
        static: True for episodes without humans.
    """
    for index in indices:
        key = EpisodeKey(seed=seed, split=split, index=index)
        scenario = handle_human_plan(planner, HumanPlanRequest(episode=key, static=static)).scenario
        motions = handle_animate(animator, AnimateRequest(scenario=scenario)).motions if scenario else None
        if scenario is not None and motions is not None:
            yield scenario, motions
