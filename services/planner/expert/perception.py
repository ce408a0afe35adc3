"""What the expert may know about humans: those in its cameras' view, and how they have moved there."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Protocol

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array
from readygo.common.camera.view import FieldOfView, in_view, view_of
from readygo.common.maps import GridFrame
from readygo.services.planner.expert.ground import EpisodeGround, SceneGround
from readygo.services.planner.expert.prediction import follow_route, predict_walk, window_steps

Pose = tuple[float, float, float]
STANDING_MPS = 0.1
"""Slower humans are taken to stand [m/s]."""
MEMORY_S = 4.0
"""How long a human that left the view stays in the map, moving on [s]."""
STANDING_MEMORY_S = 60.0
"""How long a human that stood stays in the map [s]; ends earlier when the place is seen to be empty."""
VELOCITY_WINDOW_S = 0.2
"""Mode "paper": velocities are estimated over this much continuous observation [s]."""
ROUTE_WEIGHT = 2.0
"""Weight of a walk to the robot's start or goal, if the last steps look like that; walking on as before weighs 1."""
Walks = tuple[Float64Array, Float64Array]
"""Possible positions in the next steps [m], shape (1 + K, T, 2), and how likely each row is, shape (1 + K,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PerceivedHuman:
    """A human as the expert knows it."""

    index: int
    """Index of the human in the episode."""
    x_m: float
    y_m: float
    vx_mps: float
    vy_mps: float
    seen: bool
    """True if in view now; else felt nearby, known to an oracle, or moved on from the latest view."""
    find_walks: Callable[[], Walks]
    """Works out where it may go; few steps ask for that."""
    age_s: float = 0.0
    """Time since it was perceived last [s]."""
    deviation_m: float = 0.0
    """Standard deviation of its place [m]."""
    deviation_mps: float = 0.0
    """Standard deviation of its velocity [m/s]."""

    @property
    def ahead_m(self) -> Float64Array:
        """Where it is expected after 1, 2, ... steps [m], shape (T, 2)."""
        ahead_m: Float64Array = self.find_walks()[0][0]
        return ahead_m


@dataclass(eq=False)
class _Track:
    """The latest consecutive views of one human."""

    step: int
    rows: list[tuple[float, float]]
    find_walks: Callable[[], Walks]

    @cached_property
    def walks(self) -> Walks:
        """Positions after `step`, as expected and otherwise."""
        return self.find_walks()

    def walks_after(self, elapsed: int, count: int) -> Walks:
        """Positions in the `count` steps that follow `elapsed` steps after `step`; the last ones of who stands."""
        expected_m, chances = self.walks
        first = min(elapsed, expected_m.shape[1] - count)
        return expected_m[:, first : first + count], chances


class PeopleSource(Protocol):
    """Tells an expert which humans it knows of."""

    local: EpisodeGround
    """The episode's part of the map."""

    def observe(self, step: int, pose: Pose, human_xy_m: Float64Array) -> list[PerceivedHuman]:
        """The humans that are known at a step; called at every step, and the same when it is called again.

        Args:
            step: Simulation step.
            pose: Robot's x [m], y [m], yaw [rad].
            human_xy_m: Where the humans truly are, shape (N, 2).
        """
        ...


class RobotEyes:
    """What the cameras of a robot show of a scene that is known."""

    def __init__(self, ground: SceneGround) -> None:
        """Prepare the views of all cameras.

        Args:
            ground: Robot, maps and settings.
        """
        self._ground = ground
        self._eyes = [(camera, view_of(camera)) for camera in ground.robot.all_cameras.values()]

    def show(self, pose: Pose, x_m: float, y_m: float) -> bool:
        """True if a camera shows a human at a place [m]."""
        return any(self._shows(camera.eye(*pose), view, x_m, y_m) for camera, view in self._eyes)

    def _shows(self, eye: Pose, view: FieldOfView, x_m: float, y_m: float) -> bool:
        config = self._ground.config
        if not in_view(eye, x_m, y_m, view, config.range_m, self._ground.human_radius_m):
            return False
        return not config.needs_line_of_sight or self._ground.sight.sees(eye[0], eye[1], view.height_m, (x_m, y_m))


class HumanTracks:
    """Positions of the humans while they are perceived, and what is expected of them."""

    def __init__(self, ground: SceneGround, local: EpisodeGround, paths_m: Sequence[Float64Array], count: int) -> None:
        """Begin an episode.

        Args:
            ground: Robot, maps and settings.
            local: The episode's part of the map.
            paths_m: Where the humans truly walk [m], shape (T, 2) each, for an oracle.
            count: Steps to look ahead.
        """
        config, robot = ground.config, ground.robot
        self._ground, self.local, self._config, self._count = ground, local, config, count
        self._paths_m = paths_m
        self._eyes = RobotEyes(ground)
        self._dt_s = dt_s = robot.clock.dt_s
        self._memory_steps = 0 if config.oracle else round(MEMORY_S / dt_s)
        self._standing_steps = 0 if config.oracle else round(STANDING_MEMORY_S / dt_s)
        self._curved = config.mode != "paper"
        straight_steps = round(VELOCITY_WINDOW_S / dt_s)
        self._view_count = 1 + (2 * window_steps(dt_s) if self._curved else straight_steps)
        self._window = window_steps(dt_s) if self._curved else straight_steps
        self._tracks: dict[int, _Track] = {}
        self._before_xy_m = np.empty((0, 2))
        self._observed_step = -1
        self._perceived_now: list[PerceivedHuman] = []

    def observe(self, step: int, pose: Pose, human_xy_m: Float64Array) -> list[PerceivedHuman]:
        """Look; call it at every step. A step that was observed already is not observed again.

        A human's pose shows where they walk: their step before the first view is known with it.

        Args:
            step: Simulation step.
            pose: Robot's x [m], y [m], yaw [rad].
            human_xy_m: Where the humans are, shape (N, 2).

        Returns:
            The humans in view, felt or known, and those that ceased to be and are remembered.
        """
        if step == self._observed_step:
            return self._perceived_now
        perceived = []
        for index, (x, y) in enumerate(human_xy_m.tolist()):
            seen = self._eyes.show(pose, x, y)
            if seen or self._config.oracle or math.hypot(x - pose[0], y - pose[1]) < self._config.near_field_m:
                self._remember(index, step, x, y)
            track = self._tracks.get(index)
            if track is not None and not self._forgets(track, step, pose):
                perceived.append(self._perceived_human(index, track, step, seen))
        self._before_xy_m = human_xy_m
        self._observed_step, self._perceived_now = step, perceived
        return perceived

    def _forgets(self, track: _Track, step: int, pose: Pose) -> bool:
        """True if a human was perceived too long ago, or stood at a place that is seen to be empty."""
        elapsed = step - track.step
        if elapsed == 0:
            return False
        if len(track.rows) < 2 or not stands(*self._velocity(track.rows)):
            return elapsed > self._memory_steps
        return elapsed > self._standing_steps or self._eyes.show(pose, *track.rows[-1])

    def _remember(self, index: int, step: int, x: float, y: float) -> None:
        track = self._tracks.get(index)
        if track is not None and track.step == step - 1:
            rows = track.rows
        else:
            rows = [(bx, by) for bx, by in self._before_xy_m[index : index + 1].tolist()]
        rows = [*rows[1 - self._view_count :], (x, y)]
        find_walks = partial(self._possible_positions, index, step, rows, self.local.human_ways, self.local.human_frame)
        self._tracks[index] = _Track(step=step, rows=rows, find_walks=find_walks)

    def _possible_positions(
        self, index: int, step: int, rows: list[tuple[float, float]], ways: tuple[Int32Array, ...], frame: GridFrame
    ) -> Walks:
        """Possible positions after a step."""
        count = self._count + self._memory_steps
        if self._config.oracle:
            return self._path(index, step + 1, step + 1 + count)[None], np.ones(1)
        if self._curved:
            return likely_walks(self._ground, np.array(rows), count, ways, frame)
        vx, vy = self._velocity(rows)
        t = np.arange(1, count + 1) * self._dt_s
        return np.stack([rows[-1][0] + t * vx, rows[-1][1] + t * vy], axis=1)[None], np.ones(1)

    def _path(self, index: int, first: int, end: int) -> Float64Array:
        """True positions of a human at steps first .. end - 1 [m], shape (T, 2)."""
        path = self._paths_m[index]
        true: Float64Array = path[np.minimum(np.arange(first, end), len(path) - 1)]
        return true

    def _perceived_human(self, index: int, track: _Track, step: int, seen: bool) -> PerceivedHuman:
        elapsed = step - track.step
        vx, vy = self._velocity(track.rows)
        x, y = track.rows[-1]
        if elapsed > 0:
            first = min(elapsed, track.walks[0].shape[1] - 1)
            (x, y), (x1, y1) = track.walks[0][0, first - 1 : first + 1].tolist()
            vx, vy = (x1 - x) / self._dt_s, (y1 - y) / self._dt_s
        return PerceivedHuman(
            index=index,
            x_m=x,
            y_m=y,
            vx_mps=vx,
            vy_mps=vy,
            seen=seen,
            age_s=elapsed * self._dt_s,
            find_walks=partial(track.walks_after, elapsed, self._count),
        )

    def _velocity(self, rows: list[tuple[float, float]]) -> tuple[float, float]:
        recent = rows[-self._window - 1 :]
        (x0, y0), (x1, y1) = recent[0], recent[-1]
        elapsed_s = max(len(recent) - 1, 1) * self._dt_s
        return (x1 - x0) / elapsed_s, (y1 - y0) / elapsed_s


def likely_walks(
    ground: SceneGround, views_m: Float64Array, count: int, ways: tuple[Int32Array, ...], frame: GridFrame
) -> Walks:
    """On along the present way, or along the robot's: the more a route explains, the likelier it is.

    Args:
        ground: Robot, maps and settings.
        views_m: The latest places, a step apart [m], shape (N, 2).
        count: Steps to look ahead.
        ways: Ways of humans to the robot's start and goal, see `EpisodeGround.human_ways`.
        frame: Where the cells of `ways` lie.
    """
    dt_s = ground.robot.clock.dt_s
    walks = [predict_walk(views_m, ground.human_clearance, ground.human_frame, count, dt_s)]
    weights = [1.0]
    for to_place in ways:
        route, explained = follow_route(views_m, to_place, frame, count, dt_s)
        weight = ROUTE_WEIGHT * min(max((explained - 0.5) / 0.4, 0.0), 1.0)
        if weight > 0.05:
            walks.append(route)
            weights.append(weight)
    total = math.fsum(weights)
    return np.stack(walks), np.array([weight / total for weight in weights])


def stands(vx_mps: float, vy_mps: float) -> bool:
    """True if a human with this velocity stands."""
    return vx_mps * vx_mps + vy_mps * vy_mps < STANDING_MPS**2
