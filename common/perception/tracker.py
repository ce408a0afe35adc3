"""Who is where, over time: detections become tracks of humans on a map that is known.

Each track is a Kalman filter in the world. Detections are assigned to tracks at the smallest total distance
(Mahalanobis, gated). A track's chance to be a human rises with detections, and falls where the camera should show it
and does not:

    l' = l + log(presence / (1 - presence)) - log(t / (1 - t)),   l' = l + log(1 - P_seen) where it is not detected

t is the presence that says nothing.

Humans do not walk through walls: a track that would comes to stand at the wall, and a detection inside of one is not
believed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from readygo.common.arrays import Float64Array
from readygo.common.maps import GridFrame
from readygo.common.perception import kalman
from readygo.common.perception.people import THRESHOLD, People

Pose = tuple[float, float, float]
GATE = 13.8
"""Largest squared Mahalanobis distance of a detection from its track: 99.9 % of a normal distribution."""
KNOWN = 0.0
"""Log-odds from which a track is told."""
_SAYS_NOTHING = math.log(THRESHOLD / (1.0 - THRESHOLD))
"""Log-odds of a presence that makes a track neither likelier nor less likely."""
_BEGIN = -0.5
"""Log-odds of a track before its first detection."""
_LOG_ODDS = (-2.0, 4.0)
"""Lowest one that a track is kept with, and the highest one."""
_SEEN = 0.5
"""Probability of a detection where the camera should show a human: errors hang together over time."""
MEMORY_S = 4.0
"""How long a human is told after the last detection [s]."""
UNCONFIRMED_S, CONFIRMING = 0.5, 3
"""A track of fewer detections than `CONFIRMING` ends this long after the last one [s]."""
_DOUBLE_M, _DOUBLE_MPS = 0.4, 0.7
"""Of two tracks nearer to each other than this in place [m] and velocity [m/s] the one with fewer detections ends."""
_WALL_M = 0.15
"""Humans' centres keep this clear of what blocks them, but for errors of the map [m]."""
_IN_WALL_M = 0.4
"""A detection this far from where humans can be is none [m]."""
_WALKING_SD_MPS = 0.9
"""Deviation of a human's velocity before it was observed [m/s]."""
_PLACE_SD_M = 0.05
"""Added to the deviation of every detection: bodies sway [m]."""


@dataclass(eq=False)
class Track:
    """One human."""

    number: int
    """Rises from track to track; never used again."""
    mean: Float64Array
    """x, y [m], vx, vy [m/s] in the world, shape (4,)."""
    cov: Float64Array
    """Covariance of it, shape (4, 4)."""
    log_odds: float
    """How likely it is that a human is there."""
    age_s: float = 0.0
    """Time since it was detected last [s]."""
    hits: int = 1
    """Detections so far."""


class PeopleTracker:
    """Tracks of one episode. Call `predict` at every step, and `fuse` where an image was looked at."""

    def __init__(
        self,
        clearance_m: Float64Array | None,
        frame: GridFrame | None,
        *,
        memory_s: float = MEMORY_S,
        velocities: bool = False,
    ) -> None:
        """Begin.

        Args:
            clearance_m: Distance to what blocks humans [m], shape (H, W); None where no map is known.
            frame: Where its cells lie.
            memory_s: Tracks end when they were not detected for longer [s]; unconfirmed ones sooner.
            velocities: True to fuse the velocities that looks tell; else velocities follow from places alone, which is
                better where the errors of what is told hang together over time, as a network's do
                (`docs/results/among_people.md`).
        """
        self._clearance, self._frame = clearance_m, frame
        self._memory_s, self._velocities = memory_s, velocities
        self._next = 0
        self.tracks: list[Track] = []
        """All tracks, also those that are not told yet."""

    @property
    def known(self) -> list[Track]:
        """The tracks that are told."""
        return [track for track in self.tracks if track.log_odds > KNOWN]

    def predict(self, dt_s: float) -> None:
        """Let a step pass [s]."""
        for track in self.tracks:
            self._move(track, dt_s, kalman.ACCELERATION_NOISE)
            track.age_s += dt_s
        self.tracks = [track for track in self.tracks if track.age_s <= self._lasts_s(track) + 1e-6]

    def fuse(self, pose: Pose, people: People, shows: Callable[[float, float], bool], *, late_s: float = 0.0) -> None:
        """Fuse what one look told.

        Args:
            pose: The robot when the image was taken: x, y [m], yaw [rad].
            people: What was perceived, in its frame.
            shows: True if the camera shows a human at a place of the world [m], as far as the map says.
            late_s: How long ago that was [s]: tracks are fused where they were then, and move on at their velocities.
        """
        if not late_s:
            self._fuse(pose, people, shows)
            return
        for track in self.tracks:
            kalman.predict(track.mean, track.cov, -late_s, 0.0)
        self._fuse(pose, people, shows)
        for track in self.tracks:
            self._move(track, late_s, 0.0)
            track.age_s = max(track.age_s, late_s)

    def _move(self, track: Track, time_s: float, noise: float) -> None:
        """Move a track in time at its velocity [s], and let it stand where it would walk into a wall."""
        x, y = track.mean[:2].tolist()
        kalman.predict(track.mean, track.cov, time_s, noise)
        if self._is_blocked(*track.mean[:2].tolist()) and not self._is_blocked(x, y):
            track.mean[:] = x, y, 0.0, 0.0

    def _fuse(self, pose: Pose, people: People, shows: Callable[[float, float], bool]) -> None:
        c, s = math.cos(pose[2]), math.sin(pose[2])
        turn = np.array([[c, -s], [s, c]])
        xy = people.xy_m @ turn.T + np.array(pose[:2])
        place = turn @ people.place_cov @ turn.T + _PLACE_SD_M**2 * np.eye(2)
        v = people.v_mps @ turn.T
        speed = turn @ people.velocity_cov @ turn.T
        believed = [k for k in range(len(people)) if not self._is_inside(*xy[k].tolist())]
        pairs = self._assign(xy[believed], place[believed])
        taken, hit = {believed[b] for _, b in pairs}, {a for a, _ in pairs}
        for a, b in pairs:
            k, track = believed[b], self.tracks[a]
            kalman.update(track.mean, track.cov, xy[k], place[k])
            self._fuse_velocity(track, v[k], speed[k])
            self._believe(track, float(people.presence[k]))
            track.age_s, track.hits = 0.0, track.hits + 1
        for a, track in enumerate(self.tracks):
            if a not in hit and shows(*track.mean[:2].tolist()):
                track.log_odds += math.log(1.0 - _SEEN)
        self.tracks = [track for track in self.tracks if track.log_odds > _LOG_ODDS[0] and not self._is_double(track)]
        for k in believed:
            if k not in taken:
                self._begin(xy[k], place[k], v[k], speed[k], float(people.presence[k]))

    def _lasts_s(self, track: Track) -> float:
        return self._memory_s if track.hits >= CONFIRMING else min(UNCONFIRMED_S, self._memory_s)

    def _is_double(self, track: Track) -> bool:
        """True if another track with more detections, or as many and older, is in the same place."""
        rank = (track.hits, -track.number)
        return any(
            (other.hits, -other.number) > rank
            and math.hypot(other.mean[0] - track.mean[0], other.mean[1] - track.mean[1]) < _DOUBLE_M
            and math.hypot(other.mean[2] - track.mean[2], other.mean[3] - track.mean[3]) < _DOUBLE_MPS
            for other in self.tracks
        )

    def _begin(
        self, xy: Float64Array, place: Float64Array, v: Float64Array, speed: Float64Array, presence: float
    ) -> None:
        cov = np.zeros((4, 4))
        cov[:2, :2], cov[2:, 2:] = place, _WALKING_SD_MPS**2 * np.eye(2)
        track = Track(number=self._next, mean=np.array([*xy, 0.0, 0.0]), cov=cov, log_odds=_BEGIN)
        self._fuse_velocity(track, v, speed)
        self._believe(track, presence)
        self._next += 1
        self.tracks.append(track)

    def _fuse_velocity(self, track: Track, v: Float64Array, speed: Float64Array) -> None:
        if self._velocities:
            kalman.update_velocity(track.mean, track.cov, np.ascontiguousarray(v), np.ascontiguousarray(speed))

    def _believe(self, track: Track, presence: float) -> None:
        p = min(max(presence, 0.02), 0.98)
        track.log_odds = min(track.log_odds + math.log(p / (1.0 - p)) - _SAYS_NOTHING, _LOG_ODDS[1])

    def _assign(self, xy: Float64Array, place: Float64Array) -> list[tuple[int, int]]:
        """Pairs of a track and a detection."""
        if not self.tracks or not len(xy):
            return []
        cost = np.full((len(self.tracks), len(xy)), 1e3)
        for a, track in enumerate(self.tracks):
            off = xy - track.mean[:2]
            inverse = np.linalg.inv(track.cov[:2, :2] + place)
            cost[a] = np.minimum(np.einsum("ni,nij,nj->n", off, inverse, off), 1e3)
        rows, columns = linear_sum_assignment(cost)
        return [(a, b) for a, b in zip(rows.tolist(), columns.tolist(), strict=True) if cost[a, b] <= GATE]

    def _clear_m(self, x_m: float, y_m: float) -> float:
        """Clearance of a place [m]; infinite without a map, 0 outside of it."""
        if self._clearance is None or self._frame is None:
            return math.inf
        i, j = self._frame.cell(x_m, y_m)
        height, width = self._clearance.shape
        return float(self._clearance[i, j]) if 0 <= i < height and 0 <= j < width else 0.0

    def _is_blocked(self, x_m: float, y_m: float) -> bool:
        return self._clear_m(x_m, y_m) < _WALL_M

    def _is_inside(self, x_m: float, y_m: float) -> bool:
        """True if no place nearby is free."""
        reach = _IN_WALL_M
        around = ((0.0, 0.0), (reach, 0.0), (-reach, 0.0), (0.0, reach), (0.0, -reach))
        return all(self._is_blocked(x_m + dx, y_m + dy) for dx, dy in around)
