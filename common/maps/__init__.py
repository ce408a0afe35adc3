"""Voxels and 2-D maps of a scene."""

from common.maps.grid import FloorMap, GridFrame, OccupancyMap

__all__ = ["FloorMap", "GridFrame", "OccupancyMap"]
