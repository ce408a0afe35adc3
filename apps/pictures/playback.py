"""A recorded episode as a video, from its recording only: poses, commands, images, humans."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from readygo.apps.pictures.episode_film import EpisodeFilm
from readygo.apps.pictures.side_by_side import ALONE, CAMERAS_WIDTH_PX, recorded_together, shown_images
from readygo.common.arrays import Float32Array, Float64Array, Int64Array, UInt8Array
from readygo.common.dataset import Dataset, EpisodeEntry
from readygo.common.drawing.plan_view import map_window
from readygo.common.errors import ReadygoError
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.robot import RobotConfig
from readygo.common.scenes import load_scene
from readygo.common.scenes.top_view import TopView, top_view
from readygo.runs.folder import RunFolder

MARGIN_M = 2.0
PIXEL_M = 0.02
_MAP_CELL_M = 0.25


def recorded_film(
    dataset: Dataset,
    number: int,
    camera: str = "",
    *,
    width_px: int = CAMERAS_WIDTH_PX,
) -> EpisodeFilm:
    """The video of an episode.

    Args:
        dataset: Recorded episodes.
        number: Index in `dataset.episodes`.
        camera: Name of the only camera to show; empty for all.
        width_px: Approximate width of the images of several cameras together [px].

    Raises:
        DatasetError: If there is no such camera.
    """
    entry = dataset.episodes[number]
    rows = rows_of(entry)
    poses = dataset.poses[rows][:, [0, 1, 3]]
    robot = dataset.robot or RobotConfig()
    shown = shown_images(dataset.outputs, robot, camera)
    pictures = (dataset.decode(sample) for sample in latest_pictured(dataset, rows))
    alone = shown == ALONE
    return EpisodeFilm(
        title=entry.episode.episode_id,
        camera=pictures if alone else _together(dataset, rows, shown, robot, width_px),
        enlarged=alone,
        xyyaw=poses,
        actions=dataset.actions[rows].astype(np.float64),
        goal_xy_m=_goal(poses[0], dataset.goals_xy_m[rows.start]),
        humans_xy_m=_ways(dataset.humans_of(number)),
        human_visible=dataset.truth["human_visible"][rows],
        replanned=dataset.truth["replanned"][rows],
        outcome=entry.outcome.value.replace("_", " "),
        robot_radius_m=robot.radius_m,
        rate_hz=robot.clock.rate_hz,
        v_max_mps=robot.v_max_mps,
        w_max_radps=robot.w_max_radps,
    )


def background(dataset: Dataset, number: int, data: Path) -> TopView:
    """The scene of an episode from above if it is on this machine, else empty ground around its paths."""
    try:
        spec, _ = RunFolder(data).load()
        return top_view(load_scene(Path(spec.scene_path)))
    except ReadygoError:
        return _empty_ground(dataset, number)


def latest_pictured(dataset: Dataset, rows: slice) -> Int64Array:
    """The sample of the newest image at each sample of an episode, shape (T,)."""
    numbers = np.arange(rows.start, rows.stop)
    return np.maximum.accumulate(np.where(dataset.pictured[rows], numbers, rows.start))


def rows_of(entry: EpisodeEntry) -> slice:
    """The samples of an episode."""
    return slice(entry.first_sample, entry.first_sample + entry.sample_count)


def _together(
    dataset: Dataset, rows: slice, shown: tuple[tuple[str, ...], ...], robot: RobotConfig, width_px: int
) -> Iterator[UInt8Array]:
    """The images of several cameras together, sample by sample."""
    before, picture = -1, np.zeros((0, 0, 3), np.uint8)
    for sample in latest_pictured(dataset, rows).tolist():
        if sample != before:
            before, picture = sample, recorded_together(dataset, sample, shown, robot, width_px=width_px)
        yield picture


def _empty_ground(dataset: Dataset, number: int) -> TopView:
    film = recorded_film(dataset, number)
    places = np.vstack([film.xyyaw[:, :2], film.goal_xy_m[None], *film.humans_xy_m])
    low_m, high_m = places.min(axis=0) - MARGIN_M, places.max(axis=0) + MARGIN_M
    rows, columns = np.ceil((high_m - low_m)[::-1] / _MAP_CELL_M).astype(int) + 1
    frame = GridFrame(origin_x_m=float(low_m[0]), origin_y_m=float(low_m[1]), resolution_m=_MAP_CELL_M)
    free = OccupancyMap(frame=frame, occupied=np.zeros((rows, columns), np.bool_))
    return map_window(free, low_m, high_m, pixel_m=PIXEL_M)


def _goal(pose: Float64Array, goal_xy_robot_m: Float32Array) -> Float64Array:
    """A goal in the world, shape (2,), from one in the frame of a robot at x, y, yaw."""
    (forward, left), (x, y, yaw) = goal_xy_robot_m.tolist(), pose.tolist()
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([x + cos * forward - sin * left, y + sin * forward + cos * left])


def _ways(humans: tuple[Float64Array, ...]) -> tuple[Float64Array, ...]:
    """The path of each human [m], shape (T, 2), from the positions of all humans at each sample."""
    return tuple(np.array([row[human, :2] for row in humans]) for human in range(len(humans[0])))
