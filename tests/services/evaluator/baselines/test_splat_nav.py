import dataclasses

import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.maps import FloorMap
from readygo.common.messages import Outcome
from readygo.services.evaluator.baselines.splat_nav import SplatMap, SplatNavDriver, Way, ball_heights
from tests.services.evaluator.baselines.driving import drive
from tests.services.evaluator.conftest import FRAME, ROBOT, hall


def splats(xyz, scale_m=0.06, opacity=0.9):
    count = len(xyz)
    return {
        "means_m": np.array(xyz, np.float32),
        "quats_wxyz": np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        "scales_m": np.full((count, 3), scale_m, np.float32),
        "opacities": np.full(count, opacity, np.float32),
        "sh": np.zeros((count, 1, 3), np.float32),
    }


def cloud(*parts):
    return GaussianCloud(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def hall_of_gaussians():
    """The hall of the map: Gaussians wherever it is occupied, some above another; and its floor."""
    rows, columns = np.nonzero(hall().occupied)
    walls = [((j + 0.5) * 0.1, (i + 0.5) * 0.1, z) for i, j in zip(rows, columns, strict=True) for z in (0.15, 0.4)]
    floor = [(x, y, 0.0) for x in np.arange(0.2, 12, 0.2) for y in np.arange(0.2, 6, 0.2)]
    return cloud(splats(walls), splats(floor))


def splat_map(gaussians, robot=ROBOT, unknown=None):
    floor = FloorMap(frame=FRAME, height_m=np.zeros((60, 120), np.float32))
    unknown = np.zeros((60, 120), np.bool_) if unknown is None else unknown
    return SplatMap(gaussians, floor, FRAME, unknown, robot, 0.1)


@pytest.fixture(scope="module")
def in_hall():
    return splat_map(hall_of_gaussians())


def test_balls_hold_the_body():
    for robot in (ROBOT, dataclasses.replace(ROBOT, height_m=1.2), dataclasses.replace(ROBOT, planning_radius_m=0.25)):
        heights, radius = ball_heights(robot), robot.planning_radius_m
        zs = np.linspace(0.0, robot.height_m, 50)
        wide = np.sqrt(np.maximum(radius**2 - (zs[:, None] - heights) ** 2, 0.0)).max(axis=1)
        # Nothing holds a cylinder of its own radius: then there are enough of them to miss little.
        assert wide.min() > robot.radius_m * (0.999 if radius > robot.radius_m else 0.95)


def test_goal_behind_a_wall_is_reached_without_meeting_it(in_hall):
    simulation, path = drive(SplatNavDriver(in_hall), (1.0, 1.0, 0.0), (10.0, 1.0))
    assert simulation.outcome is Outcome.SUCCESS
    assert path[:, 1].max() > 3.2


def test_path_is_safe_and_smooth(in_hall):
    path = in_hall.path_m((1.0, 1.0), (10.0, 1.0))
    steps = np.diff(path, axis=0)
    turns = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))))
    assert turns.max() < 0.3
    assert np.hypot(*steps.T).max() < 0.25
    rows, columns = np.nonzero(hall().occupied)
    things = np.stack([(columns + 0.5) * 0.1, (rows + 0.5) * 0.1], axis=1)
    middle = 0.5 * (path[:-1] + path[1:])
    for points in (path, middle):
        nearest = np.hypot(*(points[:, None] - things).transpose(2, 0, 1)).min(axis=1)
        # Balls of 0.3 m, Gaussians of 0.06 m.
        assert nearest.min() > 0.35


def test_polygons_hold_their_piece(in_hall):
    planes = in_hall.polygon(np.array([7.0, 3.6]), np.array([8.0, 3.6])).planes
    assert (planes[:, :2] @ (7.5, 3.6) < planes[:, 2] - 0.1).all()
    assert (planes[:, :2] @ (8.05, 2.8) > planes[:, 2]).any()


def test_only_what_is_in_the_way_of_the_body_blocks():
    things = {
        "low": splats([(3.0, 3.0, 0.02)]),
        "high": splats([(3.0, 3.0, 0.8)]),
        "clear": splats([(3.0, 3.0, 0.3)], opacity=0.2),
        "there": splats([(3.0, 3.0, 0.3)]),
    }
    assert {name: bool(splat_map(cloud(part)).blocked.any()) for name, part in things.items()} == {
        "low": False,
        "high": False,
        "clear": False,
        "there": True,
    }


def test_without_a_way_the_episode_ends_with_the_reason():
    unknown = np.zeros((60, 120), np.bool_)
    unknown[:, 60] = True
    parted = splat_map(cloud(splats([(3.0, 3.0, 0.3)])), unknown=unknown)
    assert parted.path_m((1.0, 1.0), (5.0, 1.0)) is not None
    way = Way(parted.path_m((1.0, 1.0), (10.0, 1.0)))
    assert "no safe way" in SplatNavDriver(parted).act([(None, way)])[0].reason
