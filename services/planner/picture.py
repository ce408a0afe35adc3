"""Pictures of episodes for reports: the map from above, who went where, and how it ended."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from common.episode import EpisodeConfig
from common.maps import GridFrame, OccupancyMap
from common.messages import EpisodeMotions, Outcome, RobotTrajectory, Scenario
from common.robot import RobotConfig

Float64Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]

_WALL, _FREE = (60, 60, 66), (246, 246, 243)
_ROBOT, _GOAL = (20, 120, 60), (70, 160, 70)
_HUMANS: tuple[Colour, ...] = ((30, 90, 200), (150, 60, 170), (0, 140, 150), (170, 110, 20))
_OUTCOMES: dict[Outcome, Colour] = {
    Outcome.SUCCESS: (20, 120, 60),
    Outcome.STATIC_COLLISION: (200, 30, 30),
    Outcome.HUMAN_COLLISION: (200, 30, 30),
    Outcome.TIMEOUT: (200, 120, 0),
}
_SUPERSAMPLING = 2


def draw_episode(
    robot_map: OccupancyMap,
    scenario: Scenario,
    trajectory: RobotTrajectory | None = None,
    *,
    motions: EpisodeMotions | None = None,
    robot: RobotConfig | None = None,
    episode_config: EpisodeConfig | None = None,
    pixels_per_m: int = 60,
    margin_m: float = 1.0,
) -> Image:
    """Draw an episode from above, x to the right and y up.

    Args:
        robot_map: What blocks the robot.
        scenario: Start, goal and humans.
        trajectory: The robot's run; without it only the scenario is drawn.
        motions: Draws the humans where their motions are, not where they were meant to go.
        robot: For the radius of its disc.
        episode_config: For the circle of success and the humans' radius.
        pixels_per_m: Scale [px/m].
        margin_m: Space around everything drawn [m].

    Returns:
        RGB image, shape (H, W, 3). Dots mark seconds; discs show where everybody is in the end.
    """
    robot, episode = robot or RobotConfig(), episode_config or EpisodeConfig()
    ways = [human.xy_m for human in scenario.humans]
    if motions is not None:
        ways = [human.motion.root_m[:, :2].astype(np.float64) for human in motions.humans]
    run = None if trajectory is None else trajectory.xyyaw[:, :2]
    canvas = _Canvas(robot_map, [scenario.start_xyyaw[None, :2], scenario.goal_xy_m[None], run, *ways], margin_m)
    canvas.paint(pixels_per_m * _SUPERSAMPLING)
    canvas.circle(scenario.goal_xy_m, episode.success_radius_m, _GOAL, 2)
    canvas.circle(scenario.goal_xy_m, 0.06, _GOAL, -1)
    end = None if run is None else len(run)
    for k, way in enumerate(ways):
        colour = _HUMANS[k % len(_HUMANS)]
        canvas.way(way, colour, None)
        canvas.way(way, colour, end)
        canvas.circle(way[min(end, len(way) - 1) if end is not None else 0], episode.human_radius_m, colour, 2)
    canvas.arrow(scenario.start_xyyaw, robot.radius_m, _ROBOT)
    if run is not None and trajectory is not None:
        canvas.way(run, _ROBOT, end)
        canvas.circle(run[-1], robot.radius_m, _OUTCOMES[trajectory.outcome], -1)
    return canvas.finished(_caption(scenario, trajectory), _OUTCOMES[trajectory.outcome] if trajectory else _WALL)


def _caption(scenario: Scenario, trajectory: RobotTrajectory | None) -> str:
    name = scenario.episode.episode_id
    if trajectory is None:
        return name
    return f"{name}  {trajectory.outcome.value.replace('_', ' ')}  {trajectory.duration_s:.1f} s"


class _Canvas:
    """A crop of a map, drawn at twice the size."""

    def __init__(self, occupancy: OccupancyMap, tracks: list[Float64Array | None], margin_m: float) -> None:
        points = np.concatenate([track for track in tracks if track is not None])
        frame, (rows, columns) = occupancy.frame, occupancy.occupied.shape
        i0, j0 = frame.cell(*(points.min(axis=0) - margin_m).tolist())
        i1, j1 = frame.cell(*(points.max(axis=0) + margin_m).tolist())
        i0, j0, i1, j1 = max(i0, 0), max(j0, 0), min(i1 + 1, rows), min(j1 + 1, columns)
        self._cells = occupancy.occupied[i0:i1, j0:j1]
        self._frame = GridFrame(
            origin_x_m=frame.origin_x_m + j0 * frame.resolution_m,
            origin_y_m=frame.origin_y_m + i0 * frame.resolution_m,
            resolution_m=frame.resolution_m,
        )

    def paint(self, pixels_per_m: int) -> None:
        """Paint the map."""
        self._scale = pixels_per_m
        size_m = np.array(self._cells.shape) * self._frame.resolution_m
        height, width = (max(8, int(length * pixels_per_m)) for length in size_m.tolist())
        coarse = np.where(self._cells[::-1, :, None], np.array(_WALL), np.array(_FREE)).astype(np.uint8)
        self._image: Any = _cv2().resize(coarse, (width, height), interpolation=_cv2().INTER_NEAREST)

    def _pixel(self, point_m: Any) -> tuple[int, int]:
        x = (float(point_m[0]) - self._frame.origin_x_m) * self._scale
        y = (float(point_m[1]) - self._frame.origin_y_m) * self._scale
        return round(x), self._image.shape[0] - 1 - round(y)

    def circle(self, centre_m: Any, radius_m: float, colour: Colour, thickness: int) -> None:
        """A circle; a negative thickness fills it."""
        radius = max(2, round(radius_m * self._scale))
        _cv2().circle(self._image, self._pixel(centre_m), radius, colour, thickness, _cv2().LINE_AA)

    def way(self, points_m: Float64Array, colour: Colour, end: int | None) -> None:
        """A way with dots at seconds up to step `end`; thin and without dots if `end` is None."""
        shown = points_m if end is None else points_m[: end + 1]
        pixels = np.array([self._pixel(point) for point in shown], dtype=np.int32)
        _cv2().polylines(self._image, [pixels], False, colour, 1 if end is None else 4, _cv2().LINE_AA)
        for point in pixels[::20] if end is not None else []:
            _cv2().circle(self._image, tuple(point.tolist()), 5, colour, -1, _cv2().LINE_AA)

    def arrow(self, xyyaw: Float64Array, radius_m: float, colour: Colour) -> None:
        """A pose: a circle and where it looks."""
        x, y, yaw = xyyaw.tolist()
        tip = (x + 1.6 * radius_m * math.cos(yaw), y + 1.6 * radius_m * math.sin(yaw))
        self.circle((x, y), radius_m, colour, 3)
        _cv2().arrowedLine(self._image, self._pixel((x, y)), self._pixel(tip), colour, 3, _cv2().LINE_AA, 0, 0.4)

    def finished(self, caption: str, colour: Colour) -> Image:
        """The picture with its caption above."""
        cv2 = _cv2()
        height, width = (size // _SUPERSAMPLING for size in self._image.shape[:2])
        picture = cv2.resize(self._image, (width, height), interpolation=cv2.INTER_AREA)
        bar = np.full((26, max(width, 300), 3), 255, np.uint8)
        cv2.putText(bar, caption, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
        body = np.full((height, bar.shape[1], 3), 255, np.uint8)
        body[:, :width] = picture
        return np.concatenate([bar, body])


def _cv2() -> Any:
    """OpenCV, loaded when a picture is drawn: planning alone does not need it."""
    import cv2

    return cv2
