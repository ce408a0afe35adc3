"""A scene and its maps from above."""

import dataclasses

import numpy as np

from readygo.common.arrays import BoolArray, UInt8Array
from readygo.common.drawing.plan_view import draw_scale_bar
from readygo.common.maps import OccupancyMap, clearance_m, free_components
from readygo.common.maps.ros_map import load_unknown_cells
from readygo.common.scenes import Scene
from readygo.common.scenes.report import HUMAN_RADIUS_M
from readygo.common.scenes.scene import HUMAN_MAP_FILE, ROBOT_MAP_FILE
from readygo.common.scenes.top_view import TopView, top_view

OCCUPIED, UNKNOWN, TOO_NARROW = (38, 44, 52), (176, 180, 186), (255, 255, 255)
SEPARATE, REACHABLE = (240, 200, 150), (150, 210, 170)
MAP_PICTURE_MIN_PX = 800
TOP_PICTURE_MIN_PX, TOP_PICTURE_MAX_PX = 1000, 4000
"""Smallest and largest longer side of the scene's picture [px]."""


def scene_pictures(scene: Scene, radius_m: float) -> dict[str, UInt8Array]:
    """The scene, what blocks the robot and what blocks humans, by file name.

    Args:
        scene: Scene bundle.
        radius_m: Radius of the robot's disc [m].
    """
    cell_m = scene.maps.robot.frame.resolution_m
    side_m = max(scene.maps.robot.occupied.shape) * cell_m
    pixel_m = top_pixel_m(side_m, cell_m)
    return {
        "top.png": _with_scale_bar(top_view(scene, pixel_m)),
        "map_robot.png": map_picture(scene.maps.robot, load_unknown_cells(scene.path / ROBOT_MAP_FILE), radius_m),
        "map_human.png": map_picture(scene.maps.human, load_unknown_cells(scene.path / HUMAN_MAP_FILE), HUMAN_RADIUS_M),
    }


def top_pixel_m(side_m: float, cell_m: float) -> float:
    """Edge of a pixel of the scene's picture [m], for a scene of a longer side and cells of its maps [m]."""
    return float(np.clip(0.4 * cell_m, side_m / TOP_PICTURE_MAX_PX, side_m / TOP_PICTURE_MIN_PX))


def map_picture(occupancy: OccupancyMap, unknown: BoolArray, radius_m: float) -> UInt8Array:
    """A map with the areas that a disc can move in, and a bar of one metre; row 0 is the largest y.

    Args:
        occupancy: Map, not inflated.
        unknown: Occupied cells that are drawn as unknown, shape (H, W).
        radius_m: Radius of the disc [m].

    Returns:
        RGB, shape (k H, k W, 3) with a whole k.
    """
    labels, _ = free_components(clearance_m(occupancy) > radius_m)
    cells = np.full((*labels.shape, 3), TOO_NARROW, np.uint8)
    cells[occupancy.occupied] = OCCUPIED
    cells[unknown] = UNKNOWN
    cells[labels > 1] = SEPARATE
    cells[labels == 1] = REACHABLE
    factor = max(1, -(-MAP_PICTURE_MIN_PX // max(labels.shape)))
    picture = cells[::-1].repeat(factor, axis=0).repeat(factor, axis=1)
    frame = dataclasses.replace(occupancy.frame, resolution_m=occupancy.frame.resolution_m / factor)
    return _with_scale_bar(TopView(rgb=picture, frame=frame))


def _with_scale_bar(view: TopView) -> UInt8Array:
    picture = np.ascontiguousarray(view.rgb)
    draw_scale_bar(picture, view)
    return picture
