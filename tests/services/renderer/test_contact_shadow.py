from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud, save_ply
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from readygo.common.messages import HumanMotion, Motion
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.scenes import Scene
from readygo.services.renderer import Renderer, RendererConfig
from readygo.services.renderer.contact_shadow import FADE_M, shadow_cloud
from readygo.services.renderer.feet import feet_of
from readygo.services.renderer.sensor.motion import posed
from tests.services.renderer.pictures import drawn

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
    off, on = (drawn(one.drawing, pose, (human,), 0).rgb.astype(int) for one in renderers(floor_scene, avatar))
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
    first = drawn(on.drawing, pose, (standing(avatar),), 0).rgb
    assert np.array_equal(drawn(on.drawing, pose, (), 0).rgb, drawn(off.drawing, pose, (), 0).rgb)
    assert np.array_equal(drawn(on.drawing, pose, (standing(avatar),), 0).rgb, first)
    floor, p_WC = floor_scene.maps.floor, pose[:3, 3]

    def shade(lifted_m: float) -> float:
        cloud = shadow_cloud(feet_of({avatar.name: avatar}, posed([standing(avatar, lifted_m)], 0)), floor, p_WC)
        return 0.0 if cloud is None else float(cloud.opacities.sum())

    assert shade(0.0) > 2 * shade(0.06) > 0.0
    assert shade(FADE_M + 0.05) == 0.0


def test_shadows_lie_on_the_floor_along_the_rays_to_the_feet(floor_scene: Scene, avatars: dict[str, Avatar]) -> None:
    avatar = next(iter(avatars.values()))
    p_WC = np.array([0.0, 0.2, FLOOR_M + 0.5])
    feet = feet_of({avatar.name: avatar}, posed([standing(avatar)], 0))
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
    images = [drawn(one.drawing, pose, (standing(avatar),), 0).rgb.astype(int) for one in (fast, slow)]
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
