"""A room of 4 x 3 m with a box in it."""

import math

import numpy as np

from readygo.common.camera.captured import CapturedViews
from readygo.common.gaussians import concatenate
from tests.common.maps.room import box, room


def small_room():
    return concatenate([room(4.0, 3.0), box((1, 1, 0), (1.4, 1.4, 0.5))])


def cameras() -> CapturedViews:
    """All around from four places in the room."""
    poses = []
    for x, y in ((0.7, 0.7), (3.3, 0.7), (3.3, 2.3), (0.7, 2.3)):
        for yaw in (k * math.tau / 8 for k in range(8)):
            T = np.eye(4)
            T[:3, 0] = (math.sin(yaw), -math.cos(yaw), 0.0)
            T[:3, 1] = (0.0, 0.0, -1.0)
            T[:3, 2] = (math.cos(yaw), math.sin(yaw), 0.0)
            T[:3, 3] = (x, y, 1.5)
            poses.append(T)
    count = len(poses)
    return CapturedViews(
        images=tuple(f"{k}.jpg" for k in range(count)),
        sizes_px=np.tile([640, 480], (count, 1)),
        K_px=np.tile(np.array([[300.0, 0.0, 320.0], [0.0, 300.0, 240.0], [0.0, 0.0, 1.0]]), (count, 1, 1)),
        T_world_camera=np.array(poses),
    )
