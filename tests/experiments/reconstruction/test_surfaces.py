from types import SimpleNamespace

import numpy as np
import pytest

from experiments.reconstruction import surfaces
from readygo.apps.capture.truth import Truth
from readygo.common.camera import CameraConfig
from readygo.common.errors import SceneError
from readygo.common.gaussians import GaussianCloud
from readygo.common.maps import OccupancyMap
from readygo.common.maps.grid import GridFrame
from readygo.services.reconstructor.similarity import Similarity

HERE = Similarity(scale=1.0, R=np.eye(3), t=np.zeros(3))
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def room(origin_x_m: float, origin_y_m: float, *, wall: bool = False) -> OccupancyMap:
    """4 x 4 m, walled in; `wall` cuts off its right quarter."""
    occupied = np.zeros((80, 80), np.bool_)
    occupied[:1] = occupied[-1:] = occupied[:, :1] = occupied[:, -1:] = True
    if wall:
        occupied[:, 60] = True
    frame = GridFrame(origin_x_m=origin_x_m, origin_y_m=origin_y_m, resolution_m=0.05)
    return OccupancyMap(frame=frame, occupied=occupied)


def scene(free: OccupancyMap, share: np.ndarray | None = None) -> SimpleNamespace:
    return SimpleNamespace(maps=SimpleNamespace(robot=free, filmed_share=share), views=None, path="nowhere")


def test_same_room_in_another_frame_is_reached_alike() -> None:
    to_true = Similarity(scale=1.0, R=np.eye(3), t=np.array([5.0, -3.0, 0.1]))
    row = surfaces.areas(scene(room(5.0, -3.0)), scene(room(0.0, 0.0)), to_true)
    assert row["reached_iou"] == 1.0
    assert row["reached_m2"] == row["reached_true_m2"] == pytest.approx(3.3**2, rel=0.05)


def test_what_was_not_filmed_is_left_out_and_what_is_cut_off_is_missing() -> None:
    share = np.ones((80, 80), np.float32)
    share[40:] = 0.2
    row = surfaces.areas(scene(room(0, 0)), scene(room(0, 0, wall=True), share), HERE)
    assert row["filmed_m2"] == pytest.approx(8.0)
    assert row["reached_m2"] < 0.8 * row["reached_true_m2"]
    assert row["reached_iou"] == pytest.approx(row["reached_m2"] / row["reached_true_m2"], abs=0.01)


def test_rotation_and_translation_between_the_worlds_are_found() -> None:
    rng = np.random.default_rng(0)
    pairs = []
    for p in rng.normal(size=(6, 3)):
        true, ours = np.eye(4), np.eye(4)
        ours[:3, 3], true[:3, 3] = p, QUARTER @ p + [1.0, 2.0, 3.0]
        pairs.append((true, ours))
    found = surfaces.rigid(pairs)
    np.testing.assert_allclose(found.R, QUARTER, atol=1e-9)
    np.testing.assert_allclose(found.t, [1.0, 2.0, 3.0], atol=1e-9)


def test_scene_of_another_capture_is_refused() -> None:
    truth = Truth(content={"frames": [], "marker": None})
    with pytest.raises(SceneError, match="no cameras of this capture"):
        surfaces.measured(truth, scene(room(0, 0)), scene(room(0, 0)), 3)


def test_plane_of_large_gaussians_is_where_rays_meet_it() -> None:
    rng = np.random.default_rng(0)
    count = 60
    floor = GaussianCloud(
        means_m=np.column_stack([rng.uniform(-3, 3, (count, 2)), np.zeros(count)]).astype(np.float32),
        quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        scales_m=np.tile(np.float32([0.6, 0.6, 1e-3]), (count, 1)),
        opacities=np.full(count, 0.9, dtype=np.float32),
        sh=np.zeros((count, 1, 3), dtype=np.float32),
    )
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 1.5)
    depth_m = surfaces.plane_depths(floor, T, CameraConfig(height_px=32, width_px=32, horizontal_fov_deg=60.0))
    np.testing.assert_allclose(depth_m, 1.5, atol=1e-3)
