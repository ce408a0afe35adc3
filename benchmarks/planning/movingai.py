"""Grid maps of the MovingAI benchmarks: a text file with one character per cell, the first line on top.

Source: N. Sturtevant, "Benchmarks for grid-based pathfinding", IEEE TCIAIG 4 (2012), and its format page.
"""

from pathlib import Path

import numpy as np

from readygo.common.errors import SceneError
from readygo.common.files import read_regular
from readygo.common.maps.grid import GridFrame, OccupancyMap

PASSABLE = ".GS"
_FILE_BYTES_MAX = 2**25
_HEADER_LINES = 4


def load_movingai_map(path: str | Path, resolution_m: float) -> OccupancyMap:
    """Read a .map; everything that is not plain ground (walls, trees, water, out of bounds) counts as occupied.

    Args:
        path: The file.
        resolution_m: Edge of a cell [m]; the files do not say. The lower left corner is the world's origin.

    Raises:
        SceneError: If the file cannot be read or is no such map.
        ValueError: If `resolution_m` is not positive.
    """
    if not 0 < resolution_m < float("inf"):
        raise ValueError(f"resolution_m must be positive, got {resolution_m}.")
    path = Path(path)
    try:
        lines = read_regular(path, bytes_max=_FILE_BYTES_MAX).decode("ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"Map {path} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    try:
        fields = dict(line.split() for line in lines[: _HEADER_LINES - 1])
        height, width = int(fields["height"]), int(fields["width"])
        well_formed = fields["type"] == "octile" and lines[_HEADER_LINES - 1].strip() == "map"
    except (KeyError, ValueError, IndexError) as error:
        raise SceneError(f"Map {path} is no MovingAI map: its header is incomplete.") from error
    rows = lines[_HEADER_LINES : _HEADER_LINES + height]
    if not well_formed or not height or len(rows) != height or any(len(row) != width for row in rows):
        raise SceneError(f"Map {path} is no MovingAI map of {height} lines of {width} cells.")
    cells = np.frombuffer("".join(rows).encode("ascii"), np.uint8).reshape(height, width)
    passable = np.isin(cells, np.frombuffer(PASSABLE.encode("ascii"), np.uint8))
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=float(resolution_m))
    return OccupancyMap(frame=frame, occupied=np.ascontiguousarray(~passable[::-1]))
