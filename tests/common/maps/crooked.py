"""A scene in which no wall is parallel to another part of the grid, and nothing is level."""

from readygo.common.frames import matrix_from_axis_angle
from readygo.common.gaussians import GaussianCloud, concatenate, transform_cloud
from tests.common.maps.room import box, room, sheet


def crooked_scene() -> GaussianCloud:
    """A tilted room, turned by 0.37 rad, with a table, a shelf that hangs, a ledge, a railing and some dust."""
    railing = [box((0.4 + 0.3 * k, 2.2, 0.0), (0.44 + 0.3 * k, 2.24, 0.9)) for k in range(3)]
    parts = [
        room(3.3, 2.7, tilt=0.02),
        box((1.1, 0.7, 0.0), (1.8, 1.2, 0.72)),
        box((2.2, 1.5, 1.1), (2.7, 2.0, 1.5)),
        sheet((0.3, 0.2, 0.13), (0.6, 0.0, 0.0), (0.0, 0.5, 0.0)),
        sheet((1.9, 0.4, 0.9), (0.3, 0.1, 0.2), (0.0, 0.2, 0.1), opacity=0.3),
        *railing,
    ]
    return transform_cloud(concatenate(parts), matrix_from_axis_angle([0.0, 0.0, 0.37]), (-1.3, 4.1, 0.6))
