from collections.abc import Callable

import cv2
import numpy as np
import pytest

from readygo.apps.capture.marker import FloorMarker, MarkedRasterizer, _window, draw_marker, lay_down
from readygo.apps.capture.walk import camera_pose
from readygo.common.camera import CameraConfig
from readygo.common.gaussians import GaussianCloud
from readygo.common.images.images import Images
from readygo.common.maps import FloorMap, GridFrame
from readygo.common.rasterizer.interface import View
from readygo.services.reconstructor.marker_sheet import draw_marker_sheet
from readygo.services.reconstructor.metric.markers import find_markers

CAMERA = CameraConfig(width_px=640, height_px=480, horizontal_fov_deg=68.0)
SLOPE = 0.02


@pytest.fixture(scope="module")
def marker() -> FloorMarker:
    return on_floor_of(0.02)


def on_floor_of(scale_m: float) -> FloorMarker:
    frame = GridFrame(origin_x_m=-2.0, origin_y_m=-2.0, resolution_m=0.1)
    height = np.broadcast_to(SLOPE * (np.arange(40) * 0.1 - 1.95), (40, 40)).astype(np.float32)
    ground_m = np.random.default_rng(0).uniform(-1.8, 1.8, (400, 2))
    sheet, floor = draw_marker_sheet("4X4_50", 7, 0.2, "A3"), FloorMap(frame=frame, height_m=height)
    cloud = GaussianCloud(
        means_m=np.column_stack([ground_m, SLOPE * ground_m[:, 0]]).astype(np.float32),
        quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (400, 1)),
        scales_m=np.tile(np.float32([scale_m, scale_m, 0.001]), (400, 1)),
        opacities=np.full(400, 0.9, np.float32),
        sh=np.zeros((400, 1, 3), np.float32),
    )
    return lay_down(sheet, cloud, floor, ground_m, (0.3, 0.1), 0.7)


def grey(depth_m: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    return np.full((480, 640, 3), 120, np.uint8), np.full((480, 640), depth_m, np.float32)


def pixels(marker: FloorMarker, T: np.ndarray) -> np.ndarray:
    uvw = (marker.corners_m - T[:3, 3]) @ T[:3, :3] @ CAMERA.K_px.T
    return uvw[:, :2] / uvw[:, 2:]


def test_sheet_lies_on_the_floors_plane(marker: FloorMarker) -> None:
    sides = np.linalg.norm(marker.corners_m - np.roll(marker.corners_m, 1, axis=0), axis=1)
    np.testing.assert_allclose(sides, 0.2, atol=1e-12)
    np.testing.assert_allclose(marker.corners_m[:, 2], SLOPE * marker.corners_m[:, 0], atol=0.004)
    assert np.ptp(marker.corners_m[:, 2] - SLOPE * marker.corners_m[:, 0]) < 1e-6


@pytest.mark.parametrize(("place", "pitch"), [((-0.9, 0.1, 1.5), -0.85), ((-0.6, -1.0, 1.4), -0.8)])
def test_corners_are_found_where_they_are(marker: FloorMarker, place: tuple[float, ...], pitch: float) -> None:
    yaw = np.arctan2(0.1 - place[1], 0.3 - place[0])
    T = camera_pose(np.array(place), yaw + 0.1, pitch, 0.05)
    rgb, depth_m = grey()
    draw_marker(rgb, depth_m, marker, T, CAMERA.K_px)
    ((number, corners_px),) = find_markers(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), "4X4_50")
    assert number == 7
    true_px = pixels(marker, T)
    assert np.abs(corners_px - true_px).max() < 0.25
    found, drawn = (np.linalg.norm(c - np.roll(c, 1, axis=0), axis=1).sum() for c in (corners_px, true_px))
    assert found == pytest.approx(drawn, rel=0.003)


def test_what_stands_before_the_marker_hides_it_and_the_floor_does_not(marker: FloorMarker) -> None:
    T = camera_pose(np.array([-0.9, 0.1, 1.5]), 0.0, -0.85, 0.0)
    rgb, _ = grey()
    table, _ = grey()
    floor, _ = grey()
    draw_marker(rgb, np.full((480, 640), np.inf, np.float32), marker, T, CAMERA.K_px)
    draw_marker(table, np.full((480, 640), 0.8, np.float32), marker, T, CAMERA.K_px)
    draw_marker(floor, floor_depth_m(marker, T, 0.04), marker, T, CAMERA.K_px)
    assert (table == 120).all()
    np.testing.assert_array_equal(floor, rgb)


def floor_depth_m(marker: FloorMarker, T: np.ndarray, above_m: float) -> np.ndarray:
    """Depths of a plane above the marker's, shape (480, 640)."""
    rows, columns = np.mgrid[0:480, 0:640] + 0.5
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(CAMERA.K_px).T @ T[:3, :3].T
    up = marker.T_world_sheet[:3, 2]
    depth_m: np.ndarray = (marker.T_world_sheet[:3, 3] + above_m * up - T[:3, 3]) @ up / (rays @ up)
    return depth_m.astype(np.float32)


def test_floor_of_large_gaussians_whose_centres_are_nearer_than_itself_hides_no_marker() -> None:
    T = camera_pose(np.array([-0.9, 0.1, 1.5]), 0.0, -0.85, 0.0)
    shown = {}
    for scale_m in (0.02, 0.15):
        marker = on_floor_of(scale_m)
        shown[scale_m], _ = grey()
        draw_marker(shown[scale_m], floor_depth_m(marker, T, 0.15), marker, T, CAMERA.K_px)
    assert (shown[0.02] == 120).all()
    assert (shown[0.15] != 120).any()


def test_camera_that_looks_away_or_from_below_sees_none(marker: FloorMarker) -> None:
    for place, yaw, pitch in (((-0.9, 0.1, 1.5), np.pi, -0.3), ((-0.5, 0.1, -1.0), 0.0, 0.8)):
        rgb, depth_m = grey()
        draw_marker(rgb, depth_m, marker, camera_pose(np.array(place), yaw, pitch, 0.0), CAMERA.K_px)
        assert (rgb == 120).all()


class Grey:
    """Draws nothing."""

    views_at_once = 2

    def render(self, views: list[View], outputs: tuple[str, ...] = ("rgb",)) -> Images:
        rgb, depth_m = grey()
        assert "median_depth" in outputs
        return Images(rgb=np.stack([rgb] * len(views)), median_depth_m=np.stack([depth_m] * len(views)))


def test_rasterizer_draws_the_marker_into_every_view_and_nothing_that_nobody_asked_for(marker: FloorMarker) -> None:
    poses = [camera_pose(np.array([x, 0.1, 1.5]), 0.0, -0.85, 0.0) for x in (-0.9, -0.8)]
    drawn = MarkedRasterizer(Grey(), CAMERA, marker).render([View(T_world_camera=T) for T in poses])
    assert drawn.median_depth_m is None
    assert all((rgb != 120).any() for rgb in drawn.rgb)
    assert (drawn.rgb[0] != drawn.rgb[1]).any()


def test_light_of_the_sheet_is_ink_where_the_printed_picture_is_black(marker: FloorMarker) -> None:
    sheet = marker.sheet
    centre = sheet.corners_m.mean(axis=0)
    rng = np.random.default_rng(2)
    points = rng.uniform((-0.02, -0.02), (sheet.width_m + 0.02, sheet.height_m + 0.02), (4000, 2))
    light, inside = marker.light_at(points - centre)
    x, y = points[:, :1], points[:, 1:]
    left, bottom, width, height = sheet.black_m.T
    black = ((x >= left) & (x < left + width) & (y >= bottom) & (y < bottom + height)).any(axis=1)
    np.testing.assert_array_equal(light, np.where(black, 0.03, 0.72))
    np.testing.assert_array_equal(
        inside, (points >= 0).all(axis=1) & (points < (sheet.width_m, sheet.height_m)).all(axis=1)
    )
    outline = (marker.outline_m - marker.T_world_sheet[:3, 3]) @ marker.T_world_sheet[:3, :3]
    low, high = -centre, (sheet.width_m, sheet.height_m) - centre
    np.testing.assert_allclose(outline[:, :2], [(low[0], high[1]), high, (high[0], low[1]), low], atol=1e-12)


def test_image_of_a_marker_is_what_it_was(marker: FloorMarker, golden_image: Callable[[str, np.ndarray], None]) -> None:
    T = camera_pose(np.array([-0.9, 0.3, 1.1]), -0.15, -0.75, 0.05)
    rgb, _ = grey()
    rgb[:, ::7] = (30, 90, 200)
    depth_m = floor_depth_m(marker, T, 0.0)
    depth_m[:, 330:] = floor_depth_m(marker, T, 0.07)[:, 330:]
    draw_marker(rgb, depth_m, marker, T, CAMERA.K_px)
    golden_image("floor_marker", rgb[60:420, 140:520])


def test_floors_gaussians_reach_as_far_as_two_sigmas_of_the_largest_but_a_few() -> None:
    assert on_floor_of(0.02).reach_m == pytest.approx(0.04)
    assert on_floor_of(0.15).reach_m == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("place", "window"),
    [
        ((-0.9, 0.1, 1.5), None),
        ((0.3, 0.1, 0.06), "whole"),
        ((9.0, 0.1, 1.5), "nowhere"),
    ],
)
def test_part_of_the_image_that_the_sheet_may_lie_in_holds_it(
    marker: FloorMarker, place: tuple[float, ...], window: str | None
) -> None:
    T = camera_pose(np.array(place), 0.0, -0.85 if window != "whole" else -0.1, 0.0)
    found = _window(marker, T, CAMERA.K_px, (480, 640))
    if window == "nowhere":
        assert found is None
    elif window == "whole":
        assert found == (0, 480, 0, 640)
    else:
        uvw = (marker.outline_m - T[:3, 3]) @ T[:3, :3] @ CAMERA.K_px.T
        (u0, v0), (u1, v1) = (getattr(uvw[:, :2] / uvw[:, 2:], way)(axis=0) for way in ("min", "max"))
        edges = [np.floor(v0) - 1, np.ceil(v1) + 1, np.floor(u0) - 1, np.ceil(u1) + 1]
        assert found == tuple(np.clip(edges, 0, (480, 480, 640, 640)))
