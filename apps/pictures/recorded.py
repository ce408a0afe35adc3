"""Recorded episodes of a run as films and as ways on a map, with the humans made again from their keys."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from readygo.apps.pictures.episode_film import EpisodeFilm, film_frames
from readygo.apps.pictures.playback import Way, recorded_film, rows_of
from readygo.apps.pictures.side_by_side import CAMERAS_WIDTH_PX
from readygo.apps.run.world import World
from readygo.common.dataset import Dataset, EpisodeEntry
from readygo.common.drawing.film import write_film
from readygo.common.drawing.plan_view import DrawnEpisode
from readygo.common.frames import wrap_angle
from readygo.common.messages import AnimateRequest, HumanPlanRequest, Scenario
from readygo.common.scenes.top_view import TopView
from readygo.services.animator import handle_animate
from readygo.services.planner import handle_human_plan

CLOSE_UP_RAD = 0.6
"""A human this far from the middle of the image is shown well [rad]."""
BEST_DISTANCE_M = 2.5
"""A human this far away is shown best [m]."""
PAGE_HEIGHT_PX, PAGE_HZ = 288, 10
"""Height of the robot's view in a page's film, about, and pictures per second."""
PAGE_WIDTH_PX = 800
"""Width of the views of several cameras together, about."""
PAGE_PICTURES_MAX = 120
"""Longer episodes are shown faster: a page holds several films, some 20 kB a picture."""


class RecordedEpisodes:
    """The episodes of one data folder."""

    def __init__(self, dataset: Dataset, world: World) -> None:
        """Prepare to draw.

        Args:
            dataset: The episodes.
            world: Of the run that recorded them.
        """
        self.dataset, self.world = dataset, world
        self._planner, self._animator = world.human_planner(), world.animator()
        self._static, self._map = world.spec.static, world.scene.maps.robot

    def humans(self, entry: EpisodeEntry) -> tuple[Scenario, tuple[Way, ...]]:
        """The scenario of an episode, and where its humans walk, shape (T, 2) each."""
        request = HumanPlanRequest(episode=entry.episode, static=self._static)
        scenario = handle_human_plan(self._planner, request).scenario
        assert scenario is not None
        motions = handle_animate(self._animator, AnimateRequest(scenario=scenario)).motions
        assert motions is not None
        return scenario, tuple(human.motion.root_m[:, :2].astype(np.float64) for human in motions.humans)

    def drawn(self, entry: EpisodeEntry) -> DrawnEpisode:
        """Where everybody went in an episode."""
        scenario, humans = self.humans(entry)
        return DrawnEpisode(
            label=entry.episode.episode_id,
            robot_xy_m=self.dataset.poses[rows_of(entry), :2].astype(np.float64),
            goal_xy_m=scenario.goal_xy_m,
            humans_xy_m=tuple(xy[: entry.sample_count] for xy in humans),
        )

    def film(self, entry: EpisodeEntry, *, width_px: int = CAMERAS_WIDTH_PX) -> EpisodeFilm:
        """An episode as a film; see `recorded_film`."""
        number = int(self.dataset.episode_of_sample[entry.first_sample])
        _, humans = self.humans(entry)
        return recorded_film(self.dataset, number, humans_xy_m=humans, width_px=width_px)

    def write_film(self, path: Path, entry: EpisodeEntry, view: TopView) -> None:
        """Write an episode as a small film for pages, at its pace or faster; its pictures say the time."""
        step = max(self.dataset.clock.rate_hz // PAGE_HZ, math.ceil(entry.sample_count / PAGE_PICTURES_MAX))
        frames = film_frames(self.film(entry, width_px=PAGE_WIDTH_PX), view, camera_height_px=PAGE_HEIGHT_PX, step=step)
        write_film(path, frames, fps=PAGE_HZ)

    def nearness(self, entry: EpisodeEntry) -> npt.NDArray[np.float64]:
        """How well a human can be seen at each sample: in view, not hidden, two to three metres away; -inf if not."""
        _, humans = self.humans(entry)
        scores = np.full(entry.sample_count, -np.inf)
        for step, (x, y, _, yaw) in enumerate(self.dataset.poses[rows_of(entry)].astype(np.float64)):
            for xy in humans:
                offset = xy[min(step, len(xy) - 1)] - (x, y)
                distance, bearing = np.hypot(*offset), wrap_angle(np.arctan2(offset[1], offset[0]) - yaw)
                if abs(bearing) < CLOSE_UP_RAD and self._sees((x, y), offset):
                    scores[step] = max(scores[step], -abs(distance - BEST_DISTANCE_M))
        return scores

    def best_encounter(self, entries: list[EpisodeEntry]) -> EpisodeEntry:
        """The episode that shows a human well for longest."""
        return max(entries, key=lambda entry: float(np.sum(self.nearness(entry) > -1.2)))

    def _sees(self, xy_m: tuple[float, float], offset_m: Way) -> bool:
        """True if nothing stands between a point and the point at an offset from it."""
        steps = max(2, int(np.hypot(*offset_m) / self._map.frame.resolution_m))
        cells = [self._map.frame.cell(*(xy_m + offset_m * share)) for share in np.linspace(0.0, 1.0, steps)]
        return not any(self._map.occupied[cell] for cell in cells)
