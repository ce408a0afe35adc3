"""Maps of a small place: a floor that rises, walls around it and a post on it."""

from types import SimpleNamespace

import numpy as np

from readygo.common.maps import FloorMap, GridFrame, OccupancyMap

FRAME = GridFrame(origin_x_m=-2.0, origin_y_m=-1.0, resolution_m=0.05)


def make_maps() -> SimpleNamespace:
    """Maps like those of a scene: `robot` and `floor`, shape (80, 160)."""
    rows, columns = 80, 160
    occupied = np.zeros((rows, columns), dtype=np.bool_)
    occupied[:4] = occupied[-4:] = occupied[:, :4] = occupied[:, -4:] = True
    occupied[40, 80] = True
    height_m = np.broadcast_to(np.linspace(0.0, 0.16, columns, dtype=np.float32), (rows, columns)).copy()
    return SimpleNamespace(
        robot=OccupancyMap(frame=FRAME, occupied=occupied), floor=FloorMap(frame=FRAME, height_m=height_m)
    )
