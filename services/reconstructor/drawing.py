"""A map of cameras and points from above."""

from collections.abc import Mapping

import cv2
import numpy as np

from readygo.common.arrays import Float64Array, Int32Array, UInt8Array
from readygo.common.drawing.plan_view import HUMANS, INK, ROBOT, draw_scale_bar, put_text
from readygo.common.maps.grid import GridFrame
from readygo.common.scenes.top_view import TopView
from readygo.services.reconstructor.posed import PosedImages

_SIDE_PX = 900
_POINTS_OF = 0.98
"""Share of the points that the picture holds; some are far away."""


def draw_map(images: PosedImages, markers: Mapping[int, Float64Array]) -> UInt8Array:
    """Points in their colours, cameras with where they look, and markers.

    Args:
        images: Metric, z up.
        markers: Corners by id, shape (4, 3) [m].

    Returns:
        Shape (H, W, 3), x to the right and y up.
    """
    view = _window(images, markers)
    order = np.argsort(images.points[:, 2])
    for (column, row), rgb in zip(_pixels(view, images.points[order]), images.points_rgb[order], strict=True):
        if 0 <= column < view.rgb.shape[1] and 0 <= row < view.rgb.shape[0]:
            view.rgb[row, column] = rgb
    centres, forward = images.T_world_camera[:, :3, 3], images.T_world_camera[:, :3, 2]
    reach_m = 20 * view.frame.resolution_m
    for begin, end in zip(_pixels(view, centres), _pixels(view, centres + reach_m * forward), strict=True):
        cv2.line(view.rgb, tuple(begin.tolist()), tuple(end.tolist()), ROBOT, 1, cv2.LINE_AA)
        cv2.circle(view.rgb, tuple(begin.tolist()), 3, ROBOT, -1, cv2.LINE_AA)
    for marker, corners in markers.items():
        cv2.polylines(view.rgb, [_pixels(view, corners)], True, HUMANS[0], 2, cv2.LINE_AA)
        column, row = _pixels(view, corners.mean(axis=0, keepdims=True))[0].tolist()
        put_text(view.rgb, str(marker), (column + 8, row - 8), colour=HUMANS[0])
    put_text(view.rgb, f"{len(images.names)} cameras, {len(images.points):,} points", (12, 24), colour=INK)
    # The bar is a metre or more.
    if view.rgb.shape[1] * view.frame.resolution_m > 1.2:
        draw_scale_bar(view.rgb, view)
    return view.rgb


def _window(images: PosedImages, markers: Mapping[int, Float64Array]) -> TopView:
    """An empty picture that holds all cameras and markers, and nearly all points."""
    inside = np.concatenate([images.T_world_camera[:, :2, 3], *(corners[:, :2] for corners in markers.values())])
    low_m, high_m = inside.min(axis=0), inside.max(axis=0)
    if len(images.points):
        share = 50.0 * (1.0 - _POINTS_OF)
        low_m = np.minimum(low_m, np.percentile(images.points[:, :2], share, axis=0))
        high_m = np.maximum(high_m, np.percentile(images.points[:, :2], 100.0 - share, axis=0))
    border_m = 0.05 * float((high_m - low_m).max()) + 1e-3
    low_m, high_m = low_m - border_m, high_m + border_m
    pixel_m = float((high_m - low_m).max()) / _SIDE_PX
    columns, rows = np.ceil((high_m - low_m) / pixel_m).astype(int).tolist()
    frame = GridFrame(origin_x_m=float(low_m[0]), origin_y_m=float(low_m[1]), resolution_m=pixel_m)
    return TopView(rgb=np.full((max(rows, 200), max(columns, 200), 3), 255, dtype=np.uint8), frame=frame)


def _pixels(view: TopView, points_m: Float64Array) -> Int32Array:
    """Columns and rows of points, shape (N, 2)."""
    column = (points_m[:, 0] - view.frame.origin_x_m) / view.frame.resolution_m
    row = view.rgb.shape[0] - (points_m[:, 1] - view.frame.origin_y_m) / view.frame.resolution_m
    return np.asarray(np.clip(np.column_stack([column, row]), -1e6, 1e6), dtype=np.int32)
