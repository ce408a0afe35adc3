"""What an expert knows of people who are tracked: from images, or from what images would tell."""

from functools import partial

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.perception import People, PeopleTracker, Track
from readygo.common.perception.episode import SteppedTracker
from readygo.services.planner.expert.ground import EpisodeGround, SceneGround
from readygo.services.planner.expert.perception import (
    MEMORY_S,
    STANDING_MPS,
    PerceivedHuman,
    Pose,
    RobotEyes,
    Walks,
    likely_walks,
)
from readygo.services.planner.expert.prediction import window_steps

_STANDING_SHARE = 1.0
"""A tracked human stands if its speed is below this share of the speed's deviation, or below `STANDING_MPS`."""


class TrackedHumans:
    """Humans as a tracker has them: call `look` with what an image told, before the expert acts."""

    def __init__(self, ground: SceneGround, local: EpisodeGround, count: int, *, velocities: bool = False) -> None:
        """Begin an episode.

        Args:
            ground: Robot, maps and settings.
            local: The episode's part of the map.
            count: Steps to look ahead.
            velocities: As for `PeopleTracker`.
        """
        self.local = local
        self.eyes = RobotEyes(ground)
        """What the robot's cameras show, as far as the map says."""
        self._ground, self._count, self._dt_s = ground, count, ground.robot.clock.dt_s
        self._views = 1 + 2 * window_steps(self._dt_s)
        self.tracker = PeopleTracker(
            ground.human_clearance, ground.human_frame, memory_s=MEMORY_S, velocities=velocities
        )
        """The tracks."""
        self._stepped = SteppedTracker(self.tracker, self._dt_s, self.eyes.show)
        self._perceived: tuple[int, list[PerceivedHuman]] | None = None

    def look(self, step: int, pose: Pose, people: People) -> None:
        """Fuse what an image told, see `readygo.common.perception.episode.TakesLooks`.

        Args:
            step: The step at which it was taken.
            pose: The robot at that step: x, y [m], yaw [rad].
            people: What was perceived, in the robot's frame.
        """
        self._stepped.look(step, pose, people)
        self._perceived = None

    def observe(self, step: int, pose: Pose, human_xy_m: Float64Array) -> list[PerceivedHuman]:
        """The humans that are tracked, see `PeopleSource`; where they truly are does not matter."""
        self._stepped.advance(step)
        if self._perceived is None or self._perceived[0] != step:
            self._perceived = step, [self._human(track) for track in self.tracker.known]
        return self._perceived[1]

    def _human(self, track: Track) -> PerceivedHuman:
        x, y, vx, vy = track.mean.tolist()
        deviation_mps = float(np.sqrt(0.5 * (track.cov[2, 2] + track.cov[3, 3])))
        if np.hypot(vx, vy) < max(STANDING_MPS, _STANDING_SHARE * min(deviation_mps, 0.25)):
            vx = vy = 0.0
        back_s = np.arange(self._views - 1, -1, -1)[:, None] * self._dt_s
        views_m = np.array([[x, y]]) - back_s * np.array([[vx, vy]])
        return PerceivedHuman(
            index=track.number,
            x_m=x,
            y_m=y,
            vx_mps=vx,
            vy_mps=vy,
            seen=track.age_s < 0.5 * self._dt_s,
            age_s=track.age_s,
            deviation_m=float(np.sqrt(0.5 * (track.cov[0, 0] + track.cov[1, 1]))),
            deviation_mps=deviation_mps,
            find_walks=partial(self._walks, views_m),
        )

    def _walks(self, views_m: Float64Array) -> Walks:
        local = self.local
        return likely_walks(self._ground, views_m, self._count, local.human_ways, local.human_frame)
