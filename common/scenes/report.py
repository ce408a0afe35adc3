"""Figures of a scene: extents, Gaussians, floor and free area."""

import math
from typing import Any

import numpy as np

from readygo.common.arrays import BoolArray
from readygo.common.gaussians import GaussianCloud
from readygo.common.maps import FloorMap, OccupancyMap, free_components
from readygo.common.maps.distance import clearance_m, farthest_m

HUMAN_RADIUS_M = 0.25


def scene_report(
    cloud: GaussianCloud,
    sky: GaussianCloud | None,
    robot_map: OccupancyMap,
    human_map: OccupancyMap,
    floor: FloorMap,
    planning_radius_m: float,
) -> dict[str, Any]:
    """Figures of a scene, as plain values; keys carry units.

    Args:
        cloud: Gaussians without the sky.
        sky: Far surroundings.
        robot_map: What blocks the robot.
        human_map: What blocks humans; same grid.
        floor: Local floor.
        planning_radius_m: Radius of the disc that the robot is planned for [m].
    """
    low, high = np.quantile(cloud.means_m.astype(np.float64), [0.005, 0.995], axis=0)
    return {
        "gaussians": len(cloud),
        "sky_gaussians": 0 if sky is None else len(sky),
        "sh_degree": cloud.sh_degree,
        "extent_low_m": _round_value(low),
        "extent_high_m": _round_value(high),
        "opacity_median": _round_value(float(np.median(cloud.opacities))),
        "opacity_below_0p1_share": _round_value(float((cloud.opacities < 0.1).mean())),
        "scale_median_m": _round_value(float(np.median(cloud.scales_m.max(axis=1))), 4),
        "map_cells": list(robot_map.occupied.shape),
        "map_resolution_m": robot_map.frame.resolution_m,
        "robot": _free_area(robot_map, planning_radius_m),
        "human": _free_area(human_map, HUMAN_RADIUS_M),
        "floor": _floor_figures(floor, ~robot_map.occupied, robot_map),
    }


def _free_area(occupancy: OccupancyMap, radius_m: float) -> dict[str, Any]:
    cell_m2 = occupancy.frame.resolution_m**2
    labels, sizes = free_components(clearance_m(occupancy) > radius_m)
    return {
        "radius_m": radius_m,
        "free_m2": _round_value(float((~occupancy.occupied).sum()) * cell_m2, 2),
        "reachable_m2": _round_value(float(sizes[1]) * cell_m2 if len(sizes) > 1 else 0.0, 2),
        "standing_m2": _round_value(float(sizes[1:].sum()) * cell_m2, 2),
        "farthest_m": _round_value(farthest_m(labels, occupancy.frame.resolution_m), 2),
        "separate_areas": len(sizes) - 1,
        "separate_areas_over_1_m2": int((sizes[1:] * cell_m2 > 1.0).sum()),
    }


def _floor_figures(floor: FloorMap, free: BoolArray, occupancy: OccupancyMap) -> dict[str, Any]:
    """Range of the floor's height where the robot may be, and its plane of least squares."""
    rows, columns = np.nonzero(free)
    if len(rows) < 3:
        return {"low_m": 0.0, "high_m": 0.0, "tilt_deg": 0.0, "roughness_m": 0.0}
    x, y = occupancy.frame.centre_m(rows, columns)
    z = floor.at_many(np.stack([x, y], axis=1))
    plane = np.stack([x - x.mean(), y - y.mean(), np.ones_like(x)], axis=1)
    (slope_x, slope_y, _), *_ = np.linalg.lstsq(plane, z, rcond=None)
    residual = z - z.mean() - plane[:, 0] * slope_x - plane[:, 1] * slope_y
    low, high = np.quantile(z, [0.01, 0.99])
    return {
        "low_m": _round_value(float(low)),
        "high_m": _round_value(float(high)),
        "tilt_deg": _round_value(math.degrees(math.atan(math.hypot(slope_x, slope_y)))),
        "roughness_m": _round_value(float(np.sqrt(np.mean(residual * residual)))),
    }


def _round_value(value: Any, digits: int = 3) -> Any:
    return [round(float(v), digits) for v in value] if isinstance(value, np.ndarray) else round(value, digits)
