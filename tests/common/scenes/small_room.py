"""A room of 4 x 3 m with a box in it."""

from readygo.common.gaussians import concatenate
from tests.common.maps.room import box, room


def small_room():
    return concatenate([room(4.0, 3.0), box((1, 1, 0), (1.4, 1.4, 0.5))])
