import math
from pathlib import Path

import numpy as np
import pytest

from readygo.common.dataset import ShardWriter, encode_episode, shard_name
from readygo.common.maps import GridFrame, OccupancyMap
from tests.apps.report.drives import drive
from tests.common.dataset.episodes import PROVENANCE


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two episodes along +x and one along +y."""
    folder = tmp_path / "data"
    folder.mkdir()
    with ShardWriter(folder / shard_name("r0", 0), PROVENANCE, fsync=False) as writer:
        for header, samples in (
            drive(0, yaw_rad=0.0, gaps_m=[2.0, 0.6, 1.0], collision_s=1.3, visible=10),
            drive(1, yaw_rad=0.0, gaps_m=[7.0], encounters=("parallel", "crossing"), visible=20),
            drive(2, yaw_rad=math.pi / 2, gaps_m=[math.inf], encounters=()),
        ):
            writer.append(encode_episode(header, 1, samples))
    return folder


@pytest.fixture
def room() -> OccupancyMap:
    """3 x 3 m around the origin, walled in."""
    occupied = np.zeros((60, 60), np.bool_)
    occupied[:2] = occupied[-2:] = occupied[:, :2] = occupied[:, -2:] = True
    return OccupancyMap(frame=GridFrame(origin_x_m=-1.0, origin_y_m=-1.0, resolution_m=0.05), occupied=occupied)
