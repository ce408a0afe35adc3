"""Voxels and 2-D maps of a scene."""

from readygo.common.maps.distance import clearance_m, farthest_m, free_components, largest_free_area
from readygo.common.maps.floor import FloorEstimate, estimate_floor
from readygo.common.maps.grid import FloorMap, GridFrame, OccupancyMap
from readygo.common.maps.occupancy import MapConfig, ScenePlan, plan_scene
from readygo.common.maps.ros_map import load_ros_map, save_ros_map
from readygo.common.maps.sight import SightMap, sight_of_cloud, sight_of_occupancy
from readygo.common.maps.voxels import opacity_sums

__all__ = [
    "FloorEstimate",
    "FloorMap",
    "GridFrame",
    "MapConfig",
    "OccupancyMap",
    "ScenePlan",
    "SightMap",
    "clearance_m",
    "estimate_floor",
    "farthest_m",
    "free_components",
    "largest_free_area",
    "load_ros_map",
    "opacity_sums",
    "plan_scene",
    "save_ros_map",
    "sight_of_cloud",
    "sight_of_occupancy",
]
