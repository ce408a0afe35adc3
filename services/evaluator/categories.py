"""How episodes fail: what to look at first."""

import enum

from readygo.common.episode import Contact, EpisodeSimulation
from readygo.common.messages import Outcome

NEAR_HUMAN_M = 2.0
"""A thing that is hit while a human is this near may have been hit to make way [m]."""
STUCK_S, STUCK_M = 10.0, 0.3
"""A robot that moved less than this distance in the last seconds is stuck [s, m]."""


class Category(enum.Enum):
    """A kind of failure."""

    SEEN_HUMAN = "drove into a human in plain view"
    UNSEEN_HUMAN = "met a human it had hardly seen"
    WALKED_INTO = "stood, and a human walked into it"
    MAKING_WAY = "hit a thing beside a human"
    THING = "hit a thing"
    STUCK = "stood still until the end"
    LATE = "drove on until the end"
    DRIVER_FAILED = "its driver failed"


def category_of(simulation: EpisodeSimulation, contact: Contact | None, failure: str = "") -> Category | None:
    """The kind of failure that an episode ended with; None after a success.

    Args:
        simulation: The episode, ended.
        contact: With a human.
        failure: Why its driver gave up, if it did.
    """
    if failure:
        return Category.DRIVER_FAILED
    if simulation.outcome is Outcome.HUMAN_COLLISION and contact is not None:
        if not contact.robot_moved:
            return Category.WALKED_INTO
        return Category.SEEN_HUMAN if contact.at_fault else Category.UNSEEN_HUMAN
    if simulation.outcome is Outcome.STATIC_COLLISION:
        near = [(x - simulation.x_m) ** 2 + (y - simulation.y_m) ** 2 for x, y in simulation.human_xy_m.tolist()]
        return Category.MAKING_WAY if min(near, default=1e9) < NEAR_HUMAN_M**2 else Category.THING
    if simulation.outcome is Outcome.TIMEOUT:
        return Category.STUCK if _is_stuck(simulation) else Category.LATE
    return None


def _is_stuck(simulation: EpisodeSimulation) -> bool:
    first = max(simulation.step - simulation.clock.steps(STUCK_S), 0)
    places = simulation.path_xyyaw(first, simulation.step)[:, :2]
    return bool((abs(places - places[-1]).max(axis=0) < STUCK_M).all())
