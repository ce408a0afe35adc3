"""The numbers of a scene's quality report as plain values; unknown ones are None."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.apps.views.places import spread_places
from readygo.apps.views.sightlines import sight_m
from readygo.apps.views.views import SceneViews, warnings
from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.camera.captured import CapturedViews
from readygo.common.documents import read_json
from readygo.common.errors import SceneError
from readygo.common.gaussians.defects import unwanted_masks
from readygo.common.maps import clearance_m, free_components
from readygo.common.maps.ros_map import load_unknown_cells
from readygo.common.scenes import Scene
from readygo.common.scenes.filmed import FILMED_MIN
from readygo.common.scenes.report import scene_report
from readygo.common.scenes.scene import HUMAN_MAP_FILE, REPORT_FILE

HOLE_MIN_M2 = 0.05
"""Smallest area of a hole in the floor [m2]; smaller ones are gaps between Gaussians."""
WALL_HEIGHTS_M = (1.0, 1.6)
"""Heights above the floor between which walls and obstacles of their height are detected [m]."""
SIGHT_PLACES, BEARINGS = 16, 72


@dataclass(frozen=True, kw_only=True, eq=False)
class Sightlines:
    """Lines of sight that leave a scene: no obstacle up to the end of its map."""

    places_m: Float64Array
    """Viewpoints [m], shape (P, 2)."""
    bearings_rad: Float64Array
    """Directions [rad], shape (B,)."""
    open: BoolArray
    """True for viewpoints and directions without an obstacle, shape (P, B)."""

    @property
    def open_share(self) -> float:
        """Share of open directions among all viewpoints and directions."""
        return float(self.open.mean())


def sightlines(scene: Scene, reachable: BoolArray) -> Sightlines:
    """Compute lines of sight at eye height from viewpoints all over the reachable ground.

    Args:
        scene: Scene bundle.
        reachable: True for cells to stand on, shape (H, W), at least one.
    """
    sight = scene.maps.sight
    places = spread_places(reachable, sight.frame, SIGHT_PLACES)
    bearings = np.arange(BEARINGS, dtype=np.float64) * np.float64(math.tau / BEARINGS)
    far_m = math.hypot(*sight.opaque.shape) * sight.frame.resolution_m
    opaque = sight.opaque_between(*WALL_HEIGHTS_M)
    seen_m = sight_m(opaque, sight.frame, places, bearings, far_m=far_m)
    return Sightlines(places_m=places, bearings_rad=bearings, open=seen_m >= far_m)


def reachable_ground(scene: Scene, radius_m: float) -> BoolArray:
    """The largest area that a disc of a radius [m] can move in, shape (H, W).

    Raises:
        SceneError: If there is no such area.
    """
    cells: BoolArray = free_components(clearance_m(scene.maps.robot) > radius_m)[0] == 1
    if not cells.any():
        raise SceneError(f"Nowhere in scene {scene.name} is there room for a disc of radius {radius_m:g} m.")
    return cells


def health(scene: Scene, radius_m: float, lines: Sightlines, seen: SceneViews) -> dict[str, Any]:
    """All numbers of the report.

    Args:
        scene: Scene bundle; reads its Gaussians.
        radius_m: Radius of the robot's disc [m].
        lines: Result of `sightlines`.
        seen: Sample views of the robot's camera.
    """
    maps = scene.maps
    figures = scene_report(scene.cloud, scene.sky, maps.robot, maps.human, maps.floor, radius_m)
    made = scene.reconstruction or {}
    masks, holes = unwanted_masks(scene.cloud), _floor_holes(scene)
    return {
        "name": scene.name,
        "content_hash": scene.content_hash,
        "license": scene.license,
        "scale": _scale(scene, made),
        "registered": made.get("verdict"),
        "cameras": 0 if scene.views is None else len(scene.views),
        "held_out": _held_out(made, scene.views),
        "unwanted": {
            kind: {"count": int(mask.sum()), "share": round(float(mask.mean()), 5)} for kind, mask in masks.items()
        },
        "floor_holes": holes,
        "open_share": round(lines.open_share, 4),
        "filmed": _coverage_numbers(scene),
        "views": seen.to_mapping(),
        "findings": [*_findings(scene), *_hole_lines(holes), *warnings(seen), *made.get("notes", [])],
        **figures,
    }


def _scale(scene: Scene, made: dict[str, Any]) -> dict[str, Any]:
    """Scale from the scene's reconstruction, else from its import."""
    if "scale" in made:
        return dict(made["scale"])
    source = scene.metadata.get("source", {})
    return {
        "metres_per_unit": source.get("scale", 1.0),
        "source": source.get("scale_origin") or "unknown",
        "interval_percent": None,
    }


def _findings(scene: Scene) -> list[str]:
    """Likely defects that were found when the maps were made."""
    try:
        return list(read_json(scene.path / REPORT_FILE).get("findings", []))
    except (OSError, ValueError, AttributeError):
        return []


def _hole_lines(holes: dict[str, Any]) -> list[str]:
    count = "a hole" if holes["count"] == 1 else f"{holes['count']} holes"
    return [f"its floor has {count}, {holes['total_m2']:.2f} m2 in all."] if holes["count"] else []


def _held_out(made: dict[str, Any], views: CapturedViews | None) -> dict[str, Any] | None:
    """Scores of the images that training did not use, with the places of their cameras."""
    training = made.get("training") or {}
    rows = training.get("held_out") or []
    if not rows:
        return None
    poses = {} if views is None else dict(zip(views.images, views.T_world_camera, strict=True))
    images = [{**row, "xyyaw": _xyyaw(poses.get(row["image"]))} for row in rows]
    return {**{name: training.get(name) for name in ("psnr_db", "psnr_fitted_db", "ssim")}, "images": images}


def _xyyaw(T_world_camera: Float64Array | None) -> list[float] | None:
    if T_world_camera is None:
        return None
    x, y = T_world_camera[:2, 3]
    yaw = math.atan2(T_world_camera[1, 2], T_world_camera[0, 2])
    return [round(float(x), 3), round(float(y), 3), round(yaw, 3)]


def _floor_holes(scene: Scene) -> dict[str, Any]:
    """Number and area of the holes in the floor: areas without floor that floor surrounds."""
    from scipy import ndimage

    unknown = load_unknown_cells(scene.path / HUMAN_MAP_FILE)
    cell_m2 = scene.maps.human.frame.resolution_m**2
    labels, count = ndimage.label(ndimage.binary_fill_holes(~unknown) & unknown)
    sizes_m2 = np.bincount(labels.reshape(-1), minlength=count + 1)[1:] * cell_m2
    holes = np.sort(sizes_m2[sizes_m2 >= HOLE_MIN_M2])[::-1]
    return {
        "count": len(holes),
        "total_m2": round(float(holes.sum()), 2),
        "largest_m2": round(float(holes[0]), 2) if len(holes) else 0.0,
    }


def _coverage_numbers(scene: Scene) -> dict[str, Any] | None:
    """Median filmed share of the views from the ground, and the area where it suffices; None without cameras."""
    share = scene.maps.filmed_share
    if share is None:
        return None
    cell_m2 = scene.maps.robot.frame.resolution_m**2
    asked = share > 0.0
    return {
        "share_median": round(float(np.median(share[asked])), 3) if asked.any() else 0.0,
        "filmed_m2": round(float((share >= FILMED_MIN).sum()) * cell_m2, 2),
        "share_min": FILMED_MIN,
        "closed": bool(dataclasses.asdict(scene.maps.config)["close_unfilmed"]),
    }
