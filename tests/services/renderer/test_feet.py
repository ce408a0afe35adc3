import math

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from readygo.common.rasterizer.interface import PosedHuman
from readygo.services.renderer.feet import LEAD_MAX_M, LEAD_SHARE, feet_of, stands_of

FRAME = GridFrame(origin_x_m=-1.0, origin_y_m=-5.0, resolution_m=0.1)
FLOOR = FloorMap(frame=FRAME, height_m=np.full((100, 160), 0.2, dtype=np.float32))


def camera(yaw_rad: float = 0.0) -> np.ndarray:
    """At (0, 0), 0.5 m above the floor, looking along +x turned by a yaw."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[s, 0.0, c, 0.0], [-c, 0.0, s, 0.0], [0.0, -1.0, 0.0, 0.7], [0.0, 0.0, 0.0, 1.0]])


def feet_at(*x_m: float) -> np.ndarray:
    """Feet of 0.2 m that point at the camera, 0.2 m apart."""
    rows = [[[[x + 0.1, y, 0.2], [x - 0.1, y, 0.2]] for y in (-0.1, 0.1)] for x in x_m]
    return np.array(rows)


def stands(feet: np.ndarray, occupied: np.ndarray | None = None, yaw_rad: float = 0.0) -> np.ndarray:
    cells = np.zeros((100, 160), dtype=np.bool_) if occupied is None else occupied
    return stands_of(feet, FLOOR, OccupancyMap(frame=FRAME, occupied=cells), camera(yaw_rad))


def test_feet_of_somebody_upright_are_on_the_ground_below_the_hips(avatars: dict[str, Avatar]) -> None:
    name, avatar = next(iter(avatars.items()))
    root = np.array([2.0, 1.0, float(avatar.joints_tpose_m[0, 1])])
    feet = feet_of({name: avatar}, [PosedHuman(avatar=name, root_m=root, pose_axis_angle=np.zeros((24, 3)))])
    assert feet.shape == (1, 2, 2, 3)
    assert np.abs(feet[..., :2] - root[:2]).max() < 0.4
    assert np.abs(feet[..., 2]).max() < 0.1
    assert feet_of({name: avatar}, []).shape == (0, 2, 2, 3)


def test_lead_is_a_share_of_the_distance_up_to_a_limit() -> None:
    ground, lead = stands(feet_at(1.0, 3.0, 12.0)).T
    assert ground == pytest.approx([0.2] * 3)
    assert lead == pytest.approx([LEAD_SHARE * 0.9, LEAD_SHARE * 2.9, LEAD_MAX_M], rel=0.02)


def test_lead_is_along_the_optical_axis() -> None:
    straight, aside = stands(feet_at(3.0)), stands(feet_at(3.0), yaw_rad=0.8)
    assert aside[0, 1] == pytest.approx(straight[0, 1] * math.cos(0.8), rel=0.05)
    assert stands(feet_at(3.0), yaw_rad=math.pi)[0, 1] == 0.0


def test_obstacle_before_a_foot_ends_its_lead_and_one_behind_does_not() -> None:
    wall = np.zeros((100, 160), dtype=np.bool_)
    wall[:, 36] = True  # x from 2.6 to 2.7 m
    assert stands(feet_at(3.0), wall)[0, 1] == pytest.approx(0.2, abs=0.051)
    assert stands(feet_at(2.8), wall)[0, 1] == pytest.approx(0.0, abs=0.051)
    assert stands(feet_at(2.0), wall)[0, 1] == stands(feet_at(2.0))[0, 1]


def test_stands_among_obstacles_on_uneven_ground_are_as_they_were(avatars: dict[str, Avatar], golden_figures) -> None:
    rng = np.random.default_rng(2)
    floor = FloorMap(frame=FRAME, height_m=rng.uniform(0.1, 0.3, (100, 160)).astype(np.float32))
    occupied = rng.random((100, 160)) < 0.01
    people = [
        PosedHuman(
            avatar=min(avatars), root_m=rng.uniform((1.0, -2.0, 0.9), (6.0, 2.0, 1.2)),
            pose_axis_angle=rng.normal(0.0, 0.3, (24, 3)),
        )
        for _ in range(9)
    ]  # fmt: skip
    feet = feet_of(avatars, people)
    golden_figures("renderer/feet", feet.reshape(9, -1))
    cells = OccupancyMap(frame=FRAME, occupied=occupied)
    golden_figures("renderer/stands", 5.0 * stands_of(feet, floor, cells, camera(0.21)))
