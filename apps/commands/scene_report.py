"""`readygo scene report`: the quality of a scene on one page."""

import json as json_module
import sys
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from readygo.apps.pictures.scene_maps import scene_pictures
from readygo.apps.report.health import (
    CLARITY,
    FILMED,
    HELD_OUT,
    SIGHT,
    VIEWS,
    filmed_map,
    health_page,
    held_out_map,
    sightlines_map,
)
from readygo.apps.report.health_numbers import health, reachable_ground, sightlines
from readygo.apps.terminal import PlainConsole
from readygo.apps.views.pictures import clarity_map, views_sheet
from readygo.apps.views.views import scene_views
from readygo.common.errors import SceneError
from readygo.common.files import write_whole
from readygo.common.robot import RobotConfig, load_robot
from readygo.runs.scene_argument import open_scene

PAGE_FILE, NUMBERS_FILE = "report.html", "report.json"


@dataclass(frozen=True, kw_only=True)
class SceneReportOptions:
    """Write a scene's quality report: scale, registration, held-out images, floaters, holes, coverage, top views."""

    scene: Positional[str]
    """Scene bundle, or "embedded"."""
    out: Path | None = None
    """Folder for report.html and report.json; the bundle's inspect/ by default."""
    radius: float | None = None
    """Radius of the robot's disc [m]; by default the one that the scene was imported for."""
    robot: Path | None = None
    """robot.toml with the camera of the sample views."""
    json: bool = False
    """Print the numbers as JSON."""


def scene_report(options: SceneReportOptions) -> None:
    """Write a scene's quality report: scale, registration, held-out images, floaters, holes, coverage, top views."""
    bundle = open_scene(options.scene)
    radius_m = float(bundle.metadata["maps"]["planning_radius_m"]) if options.radius is None else options.radius
    if not radius_m > 0:
        raise SceneError(f"--radius must be positive, got {radius_m}.")
    lines = sightlines(bundle, reachable_ground(bundle, radius_m))
    seen = scene_views(bundle, RobotConfig() if options.robot is None else load_robot(options.robot), radius_m=radius_m)
    numbers = health(bundle, radius_m, lines, seen)
    occupancy = bundle.maps.robot
    pictures = {
        **scene_pictures(bundle, radius_m),
        VIEWS: views_sheet(seen, bundle.name),
        CLARITY: clarity_map(seen, occupancy, radius_m),
        SIGHT: sightlines_map(lines, occupancy),
    }
    if bundle.maps.filmed_share is not None:
        pictures[FILMED] = filmed_map(bundle.maps.filmed_share, occupancy)
    placed = held_out_map(numbers["held_out"]["images"], occupancy) if numbers["held_out"] else None
    if placed is not None:
        pictures[HELD_OUT] = placed
    folder = bundle.path / "inspect" if options.out is None else options.out
    write_whole(folder / NUMBERS_FILE, json_module.dumps(numbers, indent=2) + "\n", raises=SceneError)
    write_whole(folder / PAGE_FILE, health_page(numbers, pictures), raises=SceneError)
    if options.json:
        sys.stdout.write(json_module.dumps(numbers) + "\n")
    else:
        PlainConsole(soft_wrap=True).print(f"Open {folder / PAGE_FILE}.", markup=False)
