"""Recorded episodes of a run as videos and as paths on a map."""

import math
from pathlib import Path

import numpy as np

from readygo.apps.pictures.episode_film import EpisodeFilm, film_frames
from readygo.apps.pictures.film import write_film
from readygo.apps.pictures.playback import recorded_film, rows_of
from readygo.apps.pictures.side_by_side import CAMERAS_WIDTH_PX
from readygo.common.arrays import Float64Array
from readygo.common.dataset import Dataset, EpisodeEntry
from readygo.common.drawing.plan_view import DrawnEpisode
from readygo.common.frames import wrap_angle
from readygo.common.maps import OccupancyMap
from readygo.common.scenes.top_view import TopView

CLOSE_UP_RAD = 0.6
"""Largest angle from the image's centre at which a human is shown well [rad]."""
BEST_DISTANCE_M = 2.5
"""Distance at which a human is shown best [m]."""
PAGE_HEIGHT_PX, PAGE_HZ = 288, 10
"""Approximate height of the robot's view in a page's video [px], and frames per second [Hz]."""
PAGE_WIDTH_PX = 800
"""Approximate width of the views of several cameras together [px]."""
PAGE_PICTURES_MAX = 120
"""Largest number of frames of a page's video, about 20 kB each: longer episodes are shown faster."""


class RecordedEpisodes:
    """The episodes of one data folder."""

    def __init__(self, dataset: Dataset, occupancy: OccupancyMap) -> None:
        """Prepare to draw.

        Args:
            dataset: The episodes.
            occupancy: Map of their scene.
        """
        self.dataset, self._map = dataset, occupancy

    def draw_episode(self, entry: EpisodeEntry) -> DrawnEpisode:
        """The trajectories of robot and humans in an episode."""
        film = self.film(entry)
        return DrawnEpisode(
            label=film.title,
            robot_xy_m=film.xyyaw[:, :2].astype(np.float64),
            goal_xy_m=film.goal_xy_m,
            humans_xy_m=tuple(_until_still(xy) for xy in film.humans_xy_m),
        )

    def film(self, entry: EpisodeEntry, *, width_px: int = CAMERAS_WIDTH_PX) -> EpisodeFilm:
        """The video of an episode, with approximate width `width_px` of several cameras' images."""
        number = int(self.dataset.episode_of_sample[entry.first_sample])
        return recorded_film(self.dataset, number, width_px=width_px)

    def write_film(self, path: Path, entry: EpisodeEntry, view: TopView) -> None:
        """Write a small video of an episode for pages, at its pace or faster; its frames show the time."""
        step = max(math.ceil(self.dataset.clock.rate_hz / PAGE_HZ), math.ceil(entry.sample_count / PAGE_PICTURES_MAX))
        frames = film_frames(self.film(entry, width_px=PAGE_WIDTH_PX), view, camera_height_px=PAGE_HEIGHT_PX, step=step)
        write_film(path, frames, fps=PAGE_HZ)

    def nearness(self, entry: EpisodeEntry) -> Float64Array:
        """Visibility score of humans at each sample, best 2 to 3 m away, in view and not hidden; -inf if invisible."""
        humans = self.film(entry).humans_xy_m
        scores = np.full(entry.sample_count, -np.inf)
        for step, (x, y, _, yaw) in enumerate(self.dataset.poses[rows_of(entry)].astype(np.float64)):
            for xy in humans:
                offset = xy[step] - (x, y)
                distance, bearing = np.hypot(*offset), wrap_angle(np.arctan2(offset[1], offset[0]) - yaw)
                if abs(bearing) < CLOSE_UP_RAD and self._sees((x, y), offset):
                    scores[step] = max(scores[step], -abs(distance - BEST_DISTANCE_M))
        return scores

    def best_encounter(self, entries: list[EpisodeEntry]) -> EpisodeEntry:
        """The episode that shows a human well for the longest time."""
        return max(entries, key=lambda entry: float(np.sum(self.nearness(entry) > -1.2)))

    def _sees(self, xy_m: tuple[float, float], offset_m: Float64Array) -> bool:
        """True if there is no obstacle between a point and the point at an offset from it."""
        steps = max(2, int(np.hypot(*offset_m) / self._map.frame.resolution_m))
        cells = [self._map.frame.cell(*(xy_m + offset_m * share)) for share in np.linspace(0.0, 1.0, steps)]
        return not any(self._map.occupied[cell] for cell in cells)


def _until_still(xy_m: Float64Array) -> Float64Array:
    """A path without the repetitions of its last point: a line's end would be drawn again for each."""
    return xy_m[: int(np.any(xy_m != xy_m[-1], axis=1).nonzero()[0].max(initial=-1)) + 2]
