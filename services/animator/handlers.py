"""Requests to the animator: no bus, no globals."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar
from readygo.common.episode import Purpose, episode_rng
from readygo.common.episode.resample import at_rate
from readygo.common.errors import AvatarError, ConfigError, MotionError
from readygo.common.extras import install_command
from readygo.common.maps.grid import FloorMap, OccupancyMap
from readygo.common.messages import AnimateReply, AnimateRequest, EpisodeMotions, HumanMotion, Motion
from readygo.common.robot.kinematics import RATE_HZ
from readygo.services.animator.config import AnimatorConfig
from readygo.services.animator.gait.human import GaitSkeleton, skeleton_of
from readygo.services.animator.gait.path import check_trajectory
from readygo.services.animator.gait.walk import walk

MotionSource = Callable[[GaitSkeleton, Float64Array, FloorMap, np.random.Generator], Motion]
"""Skeleton, trajectory (T, 2) at 20 Hz [m], floor and source of chance -> motion."""


class Animator:
    """Moves avatars along trajectories on one scene's floor."""

    def __init__(
        self,
        avatars: Mapping[str, Avatar],
        floor: FloorMap,
        config: AnimatorConfig,
        obstacles: OccupancyMap | None = None,
        rate_hz: int = RATE_HZ,
    ) -> None:
        """Measure the avatars' skeletons.

        Args:
            avatars: By the names that trajectories use.
            floor: Height of the scene's floor.
            config: How to move.
            obstacles: What blocks people; trajectories that lead through it are refused. None: not checked.
            rate_hz: Rows of the motions per second: the steps of the robot's clock.

        Raises:
            AvatarError: If an avatar has measures that no standing person has.
            ConfigError: If the motion source's files cannot be used.
        """
        self.floor = floor
        self.obstacles = obstacles
        self.rate_hz = rate_hz
        self.skeletons = {name: skeleton_of(avatar) for name, avatar in avatars.items()}
        self.move = _motion_source(config)


def _motion_source(config: AnimatorConfig) -> MotionSource:
    """The motion source that a configuration names."""
    if config.source == "priormdm":
        try:
            from readygo.services.animator.priormdm.source import PriorMdm
        except ModuleNotFoundError as error:
            raise ConfigError(
                f'source "priormdm" needs {error.name}: set source = "gait", or run: {install_command("train")}'
            ) from error
        return PriorMdm.load(config.priormdm).walk
    return lambda skeleton, xy_m, floor, rng: walk(skeleton, xy_m, floor, rng, config.style_variation)


def check_free(obstacles: OccupancyMap, xy_m: Float64Array) -> None:
    """Refuse trajectories through walls and furniture.

    Raises:
        MotionError: If the way between two rows touches an occupied cell or leaves the map.
    """
    frame, (height, width) = obstacles.frame, obstacles.occupied.shape
    longest = np.abs(np.diff(xy_m, axis=0)).max(initial=0.0)
    parts = max(math.ceil(2.0 * longest / frame.resolution_m), 1)
    ends = np.concatenate([xy_m[1:], xy_m[-1:]])
    shares = (np.arange(parts) / parts)[None, :, None]
    points = (xy_m[:, None] + shares * (ends - xy_m)[:, None]).reshape(-1, 2)
    row, column = frame.cells(points)
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    blocked = ~inside | obstacles.occupied[row.clip(0, height - 1), column.clip(0, width - 1)]
    if blocked.any():
        first = int(np.argmax(blocked))
        x_m, y_m = points[first]
        raise MotionError(
            f"The trajectory leads through an obstacle at ({x_m:.2f}, {y_m:.2f}) m, row {first // parts}; "
            "plan it on the scene's map for people."
        )


def handle_animate(animator: Animator, request: AnimateRequest) -> AnimateReply:
    """Generate the motions of a scenario's humans; an episode with a trajectory that no human can follow is rejected.

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
            check_trajectory(human.xy_m)
            if animator.obstacles is not None:
                check_free(animator.obstacles, human.xy_m)
            motion = animator.move(skeleton, human.xy_m, animator.floor, human_rng)
        except MotionError as error:
            return AnimateReply(episode=scenario.episode, rejected=f"motion: {error}")
        motions.append(HumanMotion(avatar=human.avatar, motion=at_rate(motion, animator.rate_hz)))
    return AnimateReply(episode=scenario.episode, motions=EpisodeMotions(humans=tuple(motions)))
