"""Requests to the animator: no bus, no globals."""

from collections.abc import Mapping

from common.avatars import Avatar
from common.episode import Purpose, episode_rng
from common.errors import AvatarError, MotionError
from common.maps.grid import FloorMap
from common.messages import AnimateReply, AnimateRequest, EpisodeMotions, HumanMotion
from services.animator.config import AnimatorConfig
from services.animator.gait import walk
from services.animator.gait_person import skeleton_of


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
        """
        self.floor = floor
        self.config = config
        self.skeletons = {name: skeleton_of(avatar) for name, avatar in avatars.items()}


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
            motion = walk(skeleton, human.xy_m, animator.floor, human_rng, animator.config)
        except MotionError as error:
            return AnimateReply(episode=scenario.episode, rejected=f"motion: {error}")
        motions.append(HumanMotion(avatar=human.avatar, motion=motion))
    return AnimateReply(episode=scenario.episode, motions=EpisodeMotions(humans=tuple(motions)))
