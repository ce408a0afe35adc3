from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from readygo.common.arrays import UInt8Array
from readygo.common.avatars import load_avatars
from readygo.common.maps import FloorMap, GridFrame
from readygo.common.messages import HumanMotion, Humans, RenderRequest, RenderView
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene, load_scene
from readygo.services.animator.gait.human import skeleton_of
from readygo.services.animator.gait.walk import walk
from readygo.services.renderer import Renderer, RendererConfig
from readygo.services.renderer.handlers import handle_render

Golden = Callable[[str, UInt8Array], None]
VIEWS = {"living_room": (1.17, 1.27, -3.1), "study": (1.17, -4.03, 1.21)}
"""Robot poses in the embedded scene: x [m], y [m], yaw [rad]."""


@pytest.fixture(scope="module")
def scene(embedded_bundle: Path) -> Scene:
    return load_scene(embedded_bundle)


def _walker(name: str, begin_m: tuple[float, float], end_m: tuple[float, float], floor: FloorMap) -> HumanMotion:
    """A person who passes from one point to another at 1.2 m/s."""
    length_m = float(np.hypot(end_m[0] - begin_m[0], end_m[1] - begin_m[1]))
    share = np.arange(0.0, 1.0, 1.2 * 0.05 / length_m)[:, None]
    xy_m = np.array(begin_m) * (1 - share) + np.array(end_m) * share
    skeleton = skeleton_of(load_avatars()[name])
    return HumanMotion(avatar=name, motion=walk(skeleton, xy_m, floor, np.random.default_rng(0), 0.0))


@pytest.mark.parametrize("view", sorted(VIEWS))
def test_embedded_scene_with_walking_humans_looks_as_it_did(scene: Scene, view: str, golden_image: Golden) -> None:
    robot = RobotConfig()
    renderer = Renderer(scene, load_avatars(), robot, RendererConfig())
    x_m, y_m, yaw_rad = VIEWS[view]
    floor = scene.maps.floor
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)

    def ahead(forward_m: float, left_m: float) -> tuple[float, float]:
        return x_m + c * forward_m - s * left_m, y_m + s * forward_m + c * left_m

    people = Humans(
        key="two",
        humans=(
            _walker("bruno", ahead(2.4, 1.2), ahead(2.4, -1.2), floor),
            _walker("clara", ahead(5.0, -0.6), ahead(3.0, 0.4), floor),
        ),
    )
    camera = robot.camera.T_world_camera(x_m, y_m, yaw_rad, floor.at(x_m, y_m))
    request = RenderRequest(views=(RenderView(people="two", step=22, T_world_camera=camera),), people=(people,))
    golden_image(f"embedded_{view}", handle_render(renderer, request).rgb[0])


def test_grid_frame_of_the_floor_covers_both_views(scene: Scene) -> None:
    frame: GridFrame = scene.maps.floor.frame
    rows, columns = scene.maps.floor.height_m.shape
    for x_m, y_m, _ in VIEWS.values():
        row, column = frame.cell(x_m, y_m)
        assert 0 <= row < rows
        assert 0 <= column < columns
        assert not scene.maps.robot.occupied[scene.maps.robot.frame.cell(x_m, y_m)]
