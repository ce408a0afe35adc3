"""What planning needs to know of a scene."""

from typing import Protocol

from readygo.common.maps import FloorMap, OccupancyMap, SightMap


class PlanningMaps(Protocol):
    """The maps of a scene that planning needs."""

    @property
    def robot(self) -> OccupancyMap:
        """What blocks the robot."""
        ...

    @property
    def human(self) -> OccupancyMap:
        """What blocks a human."""
        ...

    @property
    def floor(self) -> FloorMap:
        """Height of the floor."""
        ...

    @property
    def sight(self) -> SightMap:
        """What hides humans from a camera; slow to make, so only asked for where it is needed."""
        ...
