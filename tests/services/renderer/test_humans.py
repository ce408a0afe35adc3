import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud, save_ply
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from readygo.common.messages import HumanMotion, Motion
from readygo.common.rasterizer.interface import PosedHuman
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.scenes import Scene
from readygo.services.renderer import Renderer, RendererConfig
from readygo.services.renderer.humans import (
    FADE_M,
    LEAD_MAX_M,
    LEAD_SHARE,
    feet_of,
    pose_humans,
    shadow_cloud,
    stands_of,
)
from tests.services.renderer.pictures import drawn


def walker(count: int = 3) -> HumanMotion:
    rng = np.random.default_rng(0)
    rotations = Rotation.random(24 * count, rng).as_rotvec().reshape(count, 24, 3).astype(np.float32)
    root = rng.uniform(-1, 1, (count, 3)).astype(np.float32)
    return HumanMotion(avatar="a", motion=Motion(root_m=root, pose_axis_angle=rotations))


def test_joints_turn_about_one_axis_and_the_root_moves_straight() -> None:
    moving = walker()
    for share in (0.1, 0.5, 0.93):
        (between,) = pose_humans([moving], 1 + share)
        assert between.root_m == pytest.approx((1 - share) * moving.motion.root_m[1] + share * moving.motion.root_m[2])
        for joint in range(24):
            ends = Rotation.from_rotvec(moving.motion.pose_axis_angle[1:, joint])
            expected = Slerp([0, 1], ends)(share)
            assert (expected.inv() * Rotation.from_rotvec(between.pose_axis_angle[joint])).magnitude() < 1e-5
        assert np.linalg.norm(between.pose_axis_angle, axis=1).max() <= np.pi + 1e-6


def test_pose_of_a_row_is_that_row_and_the_ends_are_held() -> None:
    moving = walker()
    for step, row in ((-3, 0), (-0.5, 0), (0, 0), (1, 1), (2, 2), (2.7, 2), (9, 2)):
        (one,) = pose_humans([moving], step)
        assert np.array_equal(one.pose_axis_angle, moving.motion.pose_axis_angle[row])
        assert np.array_equal(one.root_m, moving.motion.root_m[row])


def test_small_and_resting_rotations_stay_exact() -> None:
    pose = np.zeros((2, 24, 3), dtype=np.float32)
    pose[1, 3] = (1e-8, 0, 0)
    pose[:, 4] = (0.2, -0.1, 3.0)
    still = HumanMotion(avatar="a", motion=Motion(root_m=np.zeros((2, 3), np.float32), pose_axis_angle=pose))
    (one,) = pose_humans([still], 0.5)
    assert np.abs(one.pose_axis_angle[[0, 3]]).max() < 1e-7
    assert one.pose_axis_angle[4] == pytest.approx(pose[0, 4], abs=1e-6)


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


CAMERA = CameraConfig(height_px=96, width_px=160, horizontal_fov_deg=80.0)
FLOOR_M = 0.3
AHEAD_M = 2.0


@pytest.fixture(scope="module")
def floor_scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """A white floor of overlapping Gaussians of 6 cm."""
    path = tmp_path_factory.mktemp("floor")
    x, y = np.meshgrid(np.arange(0.2, 8, 0.06), np.arange(-4, 4, 0.06))
    count = x.size
    cloud = GaussianCloud(
        means_m=np.stack([x.ravel(), y.ravel(), np.full(count, FLOOR_M)], axis=1).astype(np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (count, 1)),
        scales_m=np.tile(np.array([0.06, 0.06, 0.004], dtype=np.float32), (count, 1)),
        opacities=np.full(count, 0.9, dtype=np.float32),
        sh=np.full((count, 1, 3), 1.4, dtype=np.float32),
    )
    save_ply(cloud, path / "scene.ply")
    scene = Scene(name="floor", path=path, content_hash="f100f" * 5, metadata={"files": {"scene.ply": {}}})
    frame = GridFrame(origin_x_m=-5.0, origin_y_m=-5.0, resolution_m=1.0)
    floor = FloorMap(frame=frame, height_m=np.full((15, 10), FLOOR_M, dtype=np.float32))
    human = OccupancyMap(frame=frame, occupied=np.zeros((15, 10), dtype=np.bool_))
    scene.__dict__["maps"] = SimpleNamespace(floor=floor, human=human, robot=human)
    return scene


def standing(avatar: Avatar, lifted_m: float = 0.0) -> HumanMotion:
    pelvis_m = float(avatar.joints_tpose_m[0, 1])
    root = np.array([[AHEAD_M, 0.0, FLOOR_M + pelvis_m + lifted_m]], dtype=np.float32)
    return HumanMotion(
        avatar=avatar.name, motion=Motion(root_m=root, pose_axis_angle=np.zeros((1, 24, 3), dtype=np.float32))
    )


def renderers(scene: Scene, avatar: Avatar) -> list[Renderer]:
    avatars, robot = {avatar.name: avatar}, RobotConfig(camera=CAMERA)
    return [Renderer(scene, avatars, robot, RendererConfig(contact_shadow=shadow)) for shadow in (False, True)]


def test_shadow_darkens_the_ground_at_the_feet_and_nothing_else(floor_scene: Scene, avatars: dict[str, Avatar]) -> None:
    avatar = next(iter(avatars.values()))
    human, pose = standing(avatar), CAMERA.T_world_camera(0.0, 0.0, 0.0, FLOOR_M)
    off, on = (drawn(one, pose, (human,), 0).rgb.astype(int) for one in renderers(floor_scene, avatar))
    darker = off.mean(axis=2) - on.mean(axis=2)
    assert darker.min() > -3
    assert darker.max() > 30
    rows, columns = np.nonzero(darker > 8)
    v_feet = CAMERA.height_px / 2 + CAMERA.K_px[0, 0] * CAMERA.mount_height_m / AHEAD_M
    assert np.median(rows) == pytest.approx(v_feet, abs=5)
    assert np.median(columns) == pytest.approx(CAMERA.width_px / 2, abs=8)
    reach_px = CAMERA.K_px[0, 0] * 0.45 / AHEAD_M
    assert np.abs(columns - CAMERA.width_px / 2).max() < reach_px
    assert (darker > 8).mean() < 0.05
    # Where the person covers the scene above the feet, nothing changes.
    assert np.abs(darker[: int(v_feet) - 12]).max() < 3


def test_shadow_is_gone_without_humans_and_fades_with_height(floor_scene: Scene, avatars: dict[str, Avatar]) -> None:
    avatar = next(iter(avatars.values()))
    pose = CAMERA.T_world_camera(0.0, 0.0, 0.0, FLOOR_M)
    off, on = renderers(floor_scene, avatar)
    first = drawn(on, pose, (standing(avatar),), 0).rgb
    assert np.array_equal(drawn(on, pose, (), 0).rgb, drawn(off, pose, (), 0).rgb)
    assert np.array_equal(drawn(on, pose, (standing(avatar),), 0).rgb, first)
    floor, p_WC = floor_scene.maps.floor, pose[:3, 3]

    def shade(lifted_m: float) -> float:
        cloud = shadow_cloud(feet_of({avatar.name: avatar}, pose_humans([standing(avatar, lifted_m)], 0)), floor, p_WC)
        return 0.0 if cloud is None else float(cloud.opacities.sum())

    assert shade(0.0) > 2 * shade(0.06) > 0.0
    assert shade(FADE_M + 0.05) == 0.0


def test_shadows_lie_on_the_floor_along_the_rays_to_the_feet(floor_scene: Scene, avatars: dict[str, Avatar]) -> None:
    avatar = next(iter(avatars.values()))
    p_WC = np.array([0.0, 0.2, FLOOR_M + 0.5])
    feet = feet_of({avatar.name: avatar}, pose_humans([standing(avatar)], 0))
    cloud = shadow_cloud(feet, floor_scene.maps.floor, p_WC)
    assert cloud is not None
    rays = cloud.means_m.astype(np.float64) - p_WC
    on_floor = p_WC + rays * ((FLOOR_M - p_WC[2]) / rays[:, 2:])
    assert np.abs(on_floor[:, 0] - AHEAD_M).max() < 0.35
    assert np.abs(on_floor[:, 1]).max() < 0.4
    assert (cloud.means_m[:, 2] > FLOOR_M).all()
    assert (np.linalg.norm(on_floor - cloud.means_m, axis=1) < 0.35).all()


def test_reference_backend_draws_the_same_shadow(floor_scene: Scene, avatars: dict[str, Avatar]) -> None:
    avatar = next(iter(avatars.values()))
    robot = RobotConfig(camera=CameraConfig(height_px=32, width_px=48, horizontal_fov_deg=80.0))
    pose = robot.camera.T_world_camera(0.0, 0.0, 0.0, FLOOR_M)
    fast, slow = (
        Renderer(floor_scene, {avatar.name: avatar}, robot, RendererConfig(backend=backend, contact_shadow=True))
        for backend in ("cpu", "reference")
    )
    images = [drawn(one, pose, (standing(avatar),), 0).rgb.astype(int) for one in (fast, slow)]
    assert np.abs(images[0] - images[1]).mean() < 0.5


def test_shadows_of_crooked_feet_are_as_they_were(golden_figures) -> None:
    rng = np.random.default_rng(8)
    frame = GridFrame(origin_x_m=-3.1, origin_y_m=2.3, resolution_m=0.4)
    floor = FloorMap(frame=frame, height_m=rng.uniform(0.1, 0.25, (11, 17)).astype(np.float32))
    heels = np.column_stack([rng.uniform((-2.0, 3.0), (1.0, 5.0), (6, 2)), rng.uniform(0.15, 0.4, 6)])
    toes = heels + np.column_stack([rng.uniform(-0.2, 0.2, (6, 2)), rng.uniform(-0.05, 0.05, 6)])
    feet = np.stack([heels, toes], axis=1).reshape(3, 2, 2, 3)
    cloud = shadow_cloud(feet, floor, np.array([-0.3, 2.4, 0.7]))
    assert cloud is not None
    golden_figures("renderer/shadows", cloud.means_m, 30.0 * cloud.scales_m, cloud.opacities, cloud.quats_wxyz)
