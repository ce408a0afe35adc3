"""Voxels and 2-D maps of a scene."""

from common.maps.distance import clearance_m, free_components, largest_free_area
from common.maps.floor import FloorEstimate, estimate_floor
from common.maps.grid import FloorMap, GridFrame, OccupancyMap
from common.maps.occupancy import MapConfig, ScenePlan, plan_scene
from common.maps.ros_map import load_ros_map, save_ros_map
from common.maps.sight import SightMap, sight_of_cloud, sight_of_occupancy
from common.maps.voxels import opacity_sums

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
    "free_components",
    "largest_free_area",
    "load_ros_map",
    "opacity_sums",
    "plan_scene",
    "save_ros_map",
    "sight_of_cloud",
    "sight_of_occupancy",
]
