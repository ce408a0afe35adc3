from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud, save_ply
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from readygo.common.messages import (
    EpisodeKey,
    EpisodeMotions,
    HumanMotion,
    HumanTrajectory,
    Motion,
    Outcome,
    RobotTrajectory,
    Scenario,
    Split,
)
from readygo.common.scenes import Scene
from readygo.services.renderer import Renderer, RendererConfig
from tests.services.renderer.wearers import ROBOT, wearers


def _walls(seed: int, distance_m: float, count: int) -> GaussianCloud:
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-np.pi, np.pi, count)
    means = np.stack([distance_m * np.cos(angle), distance_m * np.sin(angle), rng.uniform(-1, 3, count)], axis=1)
    return GaussianCloud(
        means_m=means.astype(np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (count, 1)),
        scales_m=np.full((count, 3), 0.03 * distance_m, dtype=np.float32),
        opacities=np.full(count, 0.9, dtype=np.float32),
        sh=rng.uniform(-1, 1, (count, 1, 3)).astype(np.float32),
    )


def _scene(path: Path, *, sky: bool) -> Scene:
    save_ply(_walls(1, 5.0, 4000), path / "scene.ply")
    if sky:
        save_ply(_walls(2, 50.0, 500), path / "sky.ply")
    files = {name: {} for name in ("scene.ply", *(["sky.ply"] if sky else []))}
    scene = Scene(name="ring", path=path, content_hash="c0ffee" * 4, metadata={"files": files})
    frame = GridFrame(origin_x_m=-6.0, origin_y_m=-6.0, resolution_m=0.5)
    rows, columns = np.mgrid[0:24, 0:24]
    floor = FloorMap(frame=frame, height_m=(0.02 * columns - 0.01 * rows).astype(np.float32))
    human = OccupancyMap(frame=frame, occupied=np.zeros((24, 24), dtype=np.bool_))
    scene.__dict__["maps"] = SimpleNamespace(floor=floor, human=human, robot=human)
    return scene


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return _scene(tmp_path, sky=True)


@pytest.fixture(scope="session")
def avatars() -> dict[str, Avatar]:
    return wearers()


@pytest.fixture(scope="module")
def renderer(tmp_path_factory: pytest.TempPathFactory, avatars: dict[str, Avatar]) -> Renderer:
    return Renderer(_scene(tmp_path_factory.mktemp("scene"), sky=True), avatars, ROBOT, RendererConfig())


@pytest.fixture
def human(avatars: dict[str, Avatar]) -> HumanMotion:
    """Walks along +y, 2 m ahead of the origin, facing -x for two steps, then -y."""
    root = np.array([[2.0, 0.1 * step - 0.3, 0.95] for step in range(4)], dtype=np.float32)
    pose = np.zeros((4, 24, 3), dtype=np.float32)
    pose[:2, 0] = (0.0, -np.pi / 2, 0.0)
    return HumanMotion(avatar=min(avatars), motion=Motion(root_m=root, pose_axis_angle=pose))


@pytest.fixture
def episode(human: HumanMotion) -> tuple[Scenario, EpisodeMotions, RobotTrajectory]:
    steps = 7
    xyyaw = np.stack([0.05 * np.arange(steps), np.zeros(steps), 0.1 * np.arange(steps)], axis=1)
    walker = HumanTrajectory(avatar=human.avatar, encounter="crossing", speed_mps=1.0, xy_m=np.zeros((4, 2)))
    scenario = Scenario(
        episode=EpisodeKey(seed=1, split=Split.TRAIN, index=3),
        start_xyyaw=xyyaw[0].copy(),
        goal_xy_m=np.array([3.0, 1.0]),
        humans=(walker,),
    )
    trajectory = RobotTrajectory(
        outcome=Outcome.SUCCESS,
        xyyaw=xyyaw,
        actions=np.tile([1.0, 2.0], (steps, 1)) * np.arange(steps)[:, None],
        replanned=np.arange(steps) == 2,
        human_visible=np.arange(steps) < 4,
        human_distance_m=np.linspace(2, 1, steps),
        time_to_collision_s=np.full(steps, np.inf),
        expert_cost=np.arange(steps) * 1.5,
        replan_times_s=np.zeros(1),
    )
    return scenario, EpisodeMotions(humans=(human,)), trajectory
