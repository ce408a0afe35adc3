"""Requests to the animator: no bus, no globals."""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from common.avatars import Avatar
from common.episode import Purpose, episode_rng
from common.errors import AvatarError, ConfigError, MotionError
from common.maps.grid import FloorMap
from common.messages import AnimateReply, AnimateRequest, EpisodeMotions, HumanMotion, Motion
from services.animator.config import AnimatorConfig
from services.animator.gait import walk
from services.animator.gait_person import GaitSkeleton, skeleton_of

Generator = Callable[[GaitSkeleton, npt.NDArray[np.float64], FloorMap, np.random.Generator], Motion]
"""Skeleton, trajectory (T, 2) at 20 Hz [m], floor and source of chance -> motion."""


class Animator:
    """Moves avatars along trajectories on one scene's floor."""

    def __init__(self, avatars: Mapping[str, Avatar], floor: FloorMap, config: AnimatorConfig) -> None:
        """Measure the avatars' skeletons.

        Args:
            avatars: By the names that trajectories use.
            floor: Height of the scene's floor.
            config: How to move.

        Raises:
            AvatarError: If an avatar has measures that no standing person has.
            ConfigError: If the motion source's files cannot be used.
        """
        self.floor = floor
        self.config = config
        self.skeletons = {name: skeleton_of(avatar) for name, avatar in avatars.items()}
        self.generate = _generator(config)


def _generator(config: AnimatorConfig) -> Generator:
    """The motion source that a configuration names."""
    if config.source == "priormdm":
        try:
            from services.animator.priormdm.source import PriorMdm
        except ModuleNotFoundError as error:
            raise ConfigError(
                f'source "priormdm" needs {error.name}: pip install "readygo[train]", or set source = "gait".'
            ) from error
        return PriorMdm.load(config.priormdm).walk
    return lambda skeleton, xy_m, floor, rng: walk(skeleton, xy_m, floor, rng, config)


def handle_animate(animator: Animator, request: AnimateRequest) -> AnimateReply:
    """Motions of a scenario's humans; a trajectory that nobody can follow rejects the episode.

    Raises:
        AvatarError: If the scenario names an avatar that the animator does not hold.
    """
    scenario = request.scenario
    unknown = sorted({human.avatar for human in scenario.humans} - set(animator.skeletons))
    if unknown:
        raise AvatarError(
            f"Avatar {unknown[0]!r} of episode {scenario.episode.episode_id} is not loaded; "
            f"loaded: {', '.join(sorted(animator.skeletons)) or 'none'}."
        )
    rng = episode_rng(scenario.episode, Purpose.MOTION)
    motions = []
    # One stream per human: what one of them draws never changes another.
    for human, human_rng in zip(scenario.humans, rng.spawn(len(scenario.humans)), strict=True):
        skeleton = animator.skeletons[human.avatar]
        try:
            motion = animator.generate(skeleton, human.xy_m, animator.floor, human_rng)
        except MotionError as error:
            return AnimateReply(episode=scenario.episode, rejected=f"motion: {error}")
        motions.append(HumanMotion(avatar=human.avatar, motion=motion))
    return AnimateReply(episode=scenario.episode, motions=EpisodeMotions(humans=tuple(motions)))
