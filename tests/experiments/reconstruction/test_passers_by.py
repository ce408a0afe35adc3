from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.reconstruction import passers_by
from readygo.apps.capture.truth import Truth
from readygo.common.maps import OccupancyMap
from readygo.common.maps.grid import GridFrame
from readygo.common.maps.ros_map import save_ros_map

CENTRES_M = np.array([[1.0, 1.0, 1.2], [3.0, 1.0, 1.3], [2.0, 3.0, 1.1]])


def room(origin_x_m: float, origin_y_m: float) -> OccupancyMap:
    """4 x 4 m, walled in."""
    occupied = np.zeros((80, 80), np.bool_)
    occupied[:1] = occupied[-1:] = occupied[:, :1] = occupied[:, -1:] = True
    return OccupancyMap(
        frame=GridFrame(origin_x_m=origin_x_m, origin_y_m=origin_y_m, resolution_m=0.05), occupied=occupied
    )


def truth() -> Truth:
    poses = [np.block([[np.eye(3), centre[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]) for centre in CENTRES_M]
    return Truth(content={"frames": [{"image": k, "T_world_camera": pose.tolist()} for k, pose in enumerate(poses)]})


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A reconstruction that lies 5 m beside the truth, with a ghost, a cupboard, and parts unknown and not filmed."""
    found = room(5.0, 0.0)
    found.occupied[40:42, 40:43] = True
    found.occupied[1:4, 40:60] = True
    unknown = np.zeros((80, 80), np.bool_)
    unknown[50:60, 50:60] = True
    found.occupied[unknown] = True
    (tmp_path / "maps").mkdir()
    save_ros_map(found, tmp_path / "maps" / "robot.yaml", unknown=unknown)
    found.occupied[20:22, 20:22] = True
    share = np.ones((80, 80), np.float32)
    share[20:22, 20:22] = 0.0
    maps = SimpleNamespace(robot=found, filmed_share=share)
    monkeypatch.setattr(passers_by, "load_scene", lambda _: SimpleNamespace(maps=maps))
    return tmp_path


def test_ghosts_are_known_obstacles_where_the_scene_is_free(bundle: Path) -> None:
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, 3] = CENTRES_M + np.array([5.0, 0.0, 0.0])
    posed = SimpleNamespace(
        views=SimpleNamespace(images=tuple(f"{k:06d}.jpg" for k in range(3)), T_world_camera=T), masks=None
    )
    row = passers_by.ghosts(posed, truth(), room(0.0, 0.0), bundle)
    assert row["ghost_cells"] == 6
    assert row["ghosts_m2"] == pytest.approx(6 * 0.05**2)
    # 3.3 m of each side have room, less the ghosts and the unknown corner.
    assert row["free_m2"] == pytest.approx(3.3**2 - 0.015 - 0.01 - 0.25, abs=0.01)
