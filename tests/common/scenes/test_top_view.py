import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.maps import FloorMap, GridFrame
from readygo.common.scenes import save_scene
from readygo.common.scenes.top_view import draw_top_view, top_view
from tests.common.maps.room import room

FLOOR = FloorMap(
    frame=GridFrame(origin_x_m=-5, origin_y_m=-5, resolution_m=1.0), height_m=np.full((10, 10), 2.0, np.float32)
)
FRAME = GridFrame(origin_x_m=-1.0, origin_y_m=-0.5, resolution_m=0.05)
SHAPE = (20, 40)


def blob(x_m, y_m, z_m, rgb, *, opacity=0.99, sigma_m=0.1):
    return GaussianCloud(
        means_m=np.float32([[x_m, y_m, z_m]]),
        quats_wxyz=np.float32([[1, 0, 0, 0]]),
        scales_m=np.full((1, 3), sigma_m, np.float32),
        opacities=np.float32([opacity]),
        sh=((np.float32(rgb) - 0.5) / SH_C0).reshape(1, 1, 3).astype(np.float32),
    )


def draw(*blobs):
    return draw_top_view(concatenate(blobs), FLOOR, FRAME, SHAPE)


def test_world_point_is_drawn_at_its_pixel_and_large_y_is_on_top():
    view = draw(blob(0.5, 0.25, 2.0, (1, 0, 0)))
    u, v = view.world_to_pixel((0.5, 0.25))
    assert (u, v) == pytest.approx((30, 5))
    redness = view.rgb[:, :, 0].astype(int) - view.rgb[:, :, 1]
    rows, columns = np.nonzero(redness > 0.9 * redness.max())
    assert (columns + 0.5).mean() == pytest.approx(u, abs=0.1)
    assert (rows + 0.5).mean() == pytest.approx(v, abs=0.1)


def test_higher_gaussian_covers_the_lower_one_whatever_their_order():
    low, high = blob(0, 0, 2.1, (0, 0, 1)), blob(0, 0, 2.8, (0, 1, 0))
    for view in (draw(low, high), draw(high, low)):
        r, g, b = view.rgb[10, 20].tolist()
        assert g > 230
        assert r < 20
        assert b < 20


def test_ceiling_is_left_out_above_the_local_floor():
    view = draw(blob(0, 0, 2.1, (0, 0, 1)), blob(0, 0, 3.9, (0, 1, 0)))
    assert view.rgb[10, 20, 2] > 240


def test_view_of_a_scene_has_the_extent_of_its_maps(tmp_path):
    scene = save_scene(room(3.0, 3.0), None, tmp_path / "room")
    view = top_view(scene, 0.1)
    occupancy = scene.maps.robot
    assert view.rgb.shape == (occupancy.occupied.shape[0] // 2, occupancy.occupied.shape[1] // 2, 3)
    assert view.world_to_pixel((view.frame.origin_x_m, view.frame.origin_y_m)).tolist() == [0, view.rgb.shape[0]]
    assert view.rgb[view.rgb.shape[0] // 2, view.rgb.shape[1] // 2] == pytest.approx([128] * 3, abs=12)
    assert (view.rgb[0, 0] > 220).all()


def test_top_view_of_crooked_blobs_is_as_it_was(golden_figures):
    rng = np.random.default_rng(5)
    quats = rng.normal(size=(60, 4))
    cloud = GaussianCloud(
        means_m=rng.uniform((-1.2, -0.6, 1.8), (1.1, 0.6, 4.5), (60, 3)).astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales_m=rng.uniform(0.02, 0.2, (60, 3)).astype(np.float32),
        opacities=rng.uniform(0.05, 1.0, 60).astype(np.float32),
        sh=rng.uniform(-1.0, 1.0, (60, 1, 3)).astype(np.float32),
    )
    view = draw_top_view(cloud, FLOOR, FRAME, SHAPE)
    golden_figures("scenes/top view", view.rgb.reshape(-1, 3) / 64.0)
