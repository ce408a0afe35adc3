"""Named mixes of humans: functions that change how many come, how fast they are and how they meet the robot."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

from readygo.common.episode import EpisodeConfig
from readygo.services.planner.humans.config import PAPER_MIX, FamilyMix, HumanPlannerConfig

Mix = tuple[EpisodeConfig, HumanPlannerConfig]
"""Both sections of settings that say who comes."""
MixName = Literal["paper", "varied", "crowd"]

_PLACES: dict[str, Any] = {"slope_max": 0.35, "fewer_humans": True, "effort": "quick"}


def paper(episode: EpisodeConfig, planner: HumanPlannerConfig) -> Mix:
    """One or two humans at 0.8-1.4 m/s who cross the way or walk along it: the frozen mix of success rates."""
    return (
        replace(episode, human_count_min=1, human_count_max=2, human_speed_min_mps=0.8, human_speed_max_mps=1.4),
        replace(planner, mix=PAPER_MIX),
    )


def varied_mix(episode: EpisodeConfig, planner: HumanPlannerConfig) -> Mix:
    """Up to four humans at 0.5-2.0 m/s from all families; fewer where they find no room."""
    mix = FamilyMix(
        crossing=0.14,
        parallel=0.12,
        frontal=0.12,
        overtaking=0.10,
        crossing_left=0.06,
        crossing_right=0.06,
        blind_corner=0.10,
        doorway=0.10,
        standing_group=0.08,
        stop_and_go=0.07,
        goalward=0.05,
    )
    return (
        replace(episode, human_count_min=0, human_count_max=4, human_speed_min_mps=0.5, human_speed_max_mps=2.0),
        replace(planner, mix=mix, **_PLACES),
    )


def crowd(episode: EpisodeConfig, planner: HumanPlannerConfig) -> Mix:
    """Two to four humans at 0.5-1.5 m/s: much cross traffic and groups that stand."""
    mix = FamilyMix(
        crossing=0.25, parallel=0.2, frontal=0.15, overtaking=0.05, doorway=0.1, standing_group=0.15, stop_and_go=0.1
    )
    return (
        replace(episode, human_count_min=2, human_count_max=4, human_speed_min_mps=0.5, human_speed_max_mps=1.5),
        replace(planner, mix=mix, **_PLACES),
    )


MIXES: dict[MixName, Callable[[EpisodeConfig, HumanPlannerConfig], Mix]] = {
    "paper": paper,
    "varied": varied_mix,
    "crowd": crowd,
}
