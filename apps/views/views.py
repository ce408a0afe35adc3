"""Sample views of the robot's camera in a scene: their sharpness, and their coverage by surfaces."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from readygo.apps.views.places import poses_to_look_from
from readygo.common.errors import SceneError
from readygo.common.images.clarity import COVERED_FROM, SHARP_FROM
from readygo.common.maps import clearance_m, free_components
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene
from readygo.services.renderer import Look, Renderer, RendererConfig, look_around

PLACES = 24
TOLERATED = 1 / 8
"""Share of places with bad views that causes no warning."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewPlace:
    """The views from one place."""

    looks: tuple[Look, ...]
    """Views a quarter turn apart."""

    @cached_property
    def typical(self) -> Look:
        """The second sharpest view, which represents the place: close walls fill the less sharp ones."""
        return sorted(self.looks, key=lambda look: look.sharpness)[-2]

    @property
    def blurred(self) -> bool:
        """True if the typical view is blurred."""
        return self.typical.sharpness < SHARP_FROM

    @property
    def bare(self) -> bool:
        """True if surfaces cover little of the typical view."""
        return self.typical.coverage < COVERED_FROM


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneViews:
    """Places spread over the reachable ground of a scene."""

    places: tuple[ViewPlace, ...]

    @property
    def sharpness(self) -> float:
        """Median sharpness over the places."""
        return float(np.median([place.typical.sharpness for place in self.places]))

    @property
    def coverage(self) -> float:
        """Median coverage over the places, 0..1."""
        return float(np.median([place.typical.coverage for place in self.places]))

    @property
    def blurred(self) -> int:
        """Number of blurred places."""
        return sum(place.blurred for place in self.places)

    @property
    def bare(self) -> int:
        """Number of places from which surfaces cover little of the view."""
        return sum(place.bare for place in self.places)

    def to_mapping(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "sharpness_median": round(self.sharpness, 1),
            "coverage_median": round(self.coverage, 3),
            "places": [
                {
                    "xyyaw": [round(value, 3) for value in place.typical.xyyaw],
                    "sharpness": round(place.typical.sharpness, 1),
                    "coverage": round(place.typical.coverage, 3),
                }
                for place in self.places
            ],
            "blurred_places": self.blurred,
            "bare_places": self.bare,
        }


def scene_views(scene: Scene, robot: RobotConfig, *, radius_m: float | None = None, places: int = PLACES) -> SceneViews:
    """Render views from places spread over the ground that a robot can reach, without humans.

    Args:
        scene: Scene bundle.
        robot: Robot with the camera.
        radius_m: Radius of the disc that can reach the places [m]; by default the one that the scene was imported for.
        places: Number of places.

    Raises:
        SceneError: If the disc cannot stand anywhere.
    """
    radius_m = float(scene.metadata["maps"]["planning_radius_m"]) if radius_m is None else radius_m
    labels, _ = free_components(clearance_m(scene.maps.robot) > radius_m)
    if not (labels == 1).any():
        raise SceneError(f"Nowhere in scene {scene.name} is there room for a disc of radius {radius_m:g} m.")
    poses = poses_to_look_from(labels == 1, scene.maps.robot.frame, places)
    looks = list(look_around(Renderer(scene, {}, robot, RendererConfig()), poses.reshape(-1, 3)))
    width = poses.shape[1]
    return SceneViews(places=tuple(ViewPlace(looks=tuple(looks[k : k + width])) for k in range(0, len(looks), width)))


def warnings(views: SceneViews) -> list[str]:
    """Warnings about the robot's views, a line each; empty if the views are good at most places."""
    count, found = len(views.places), []
    if (blurred := views.blurred) > TOLERATED * count:
        found.append(
            f"{blurred} of {count} places are blurred (sharpness below {SHARP_FROM:g}, median {views.sharpness:.0f}): "
            "the camera stands in haze or looks at unfilmed parts; "
            f"[episode] sharpness_min = {SHARP_FROM:g} leaves out episodes that show no more."
        )
    if (bare := views.bare) > TOLERATED * count:
        found.append(
            f"From {bare} of {count} places less than {100 * COVERED_FROM:.0f} % of the view is surface (median "
            f"{100 * views.coverage:.0f} %), the rest haze or nothing; "
            f"[episode] coverage_min = {COVERED_FROM:g} leaves out episodes that show no more."
        )
    return found
