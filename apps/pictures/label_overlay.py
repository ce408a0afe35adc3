"""Labels of humans drawn over the images of a dataset, to check that they fit."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.avatars import SMPL_PARENTS
from readygo.common.dataset import Calibration, Dataset
from readygo.common.drawing.plan_view import GOAL, HUMANS, INK, WHITE, Rgb, put_text
from readygo.common.drawing.sheet import line_swatch, sheet
from readygo.common.errors import DatasetError

COLUMNS, TILES = 2, 8
WIDTH_PX = 640
"""Width of one image on the sheet [px]."""
NEAR_M = 0.1
NEAREST_SHOWN_M = 1.5
"""Smallest distance of a human that fits into an image [m]."""
_SUBPIXEL_BITS = 4
_EDGES = [(a, a ^ bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]


def label_overlay(dataset: Dataset) -> UInt8Array:
    """A sheet of up to eight images, spread over the samples in which the robot sees a human.

    All humans within the view are drawn, also behind walls: joints and bones, the box, the ground points.

    Args:
        dataset: Dataset with labels.

    Returns:
        RGB image of the sheet.

    Raises:
        DatasetError: If the dataset has no labels, names no robot, or shows no human.
    """
    seen = np.flatnonzero(dataset.truth["human_visible"])
    if len(seen) == 0:
        raise DatasetError("There is no sample in which the robot sees a human.")
    parts = np.array_split(seen, min(TILES, len(seen)))
    chosen = [min(part.tolist(), key=lambda index: _ahead_m(dataset, index)) for part in parts]
    tiles = [labelled_image(dataset, index) for index in chosen]
    rows = [tiles[k : k + COLUMNS] for k in range(0, len(tiles), COLUMNS)]
    legend = [
        (line_swatch(colour), f"human {k}")
        for k, colour in enumerate(HUMANS[: max(map(len, map(dataset.boxes, chosen)))])
    ]
    return sheet(rows, [("labels of people", INK), ("joints, box, footprint; behind walls too", GOAL)], legend)


def labelled_image(dataset: Dataset, index: int) -> UInt8Array:
    """One image, enlarged, with the labels of its sample."""
    if dataset.robot is None:
        raise DatasetError("The metadata names no robot: where its camera is, is unknown.")
    calibration = dataset.calibration(index)
    x_m, y_m, z_m, yaw_rad = dataset.poses[index].tolist()
    robot = dataset.robot.with_values(dataset.episodes[dataset.episode_of_sample[index]].drawn)
    T_world_camera = robot.camera.T_world_camera(x_m, y_m, yaw_rad, z_m)
    scale = WIDTH_PX / calibration.width_px
    size = (WIDTH_PX, round(calibration.height_px * scale))
    picture = np.asarray(cv2.resize(dataset.decode(index), size, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
    humans = zip(dataset.joints_m(index), dataset.boxes(index), dataset.footprints_xy_m(index), strict=True)
    for k, (joints_m, box, ground_m) in enumerate(humans):
        colour = HUMANS[k % len(HUMANS)]
        at_floor = np.full((len(ground_m), 1), box[2] - 0.5 * box[5])
        parts = (joints_m, corners(box), np.concatenate([ground_m, at_floor], axis=1))
        joints, edges, ground = (scale * project(points, T_world_camera, calibration) for points in parts)
        _dots(picture, ground, colour, 1.0)
        _lines(picture, edges, _EDGES, colour, 1)
        _lines(picture, joints, [(j, int(SMPL_PARENTS[j])) for j in range(1, 24)], colour, 2)
        _dots(picture, joints, (255, 255, 255), 2.0)
    put_text(picture, f"sample {index}", (8, size[1] - 10), halo=WHITE)
    return picture


def corners(box: Float64Array) -> Float64Array:
    """The corners [m] of a box as in `HumanLabels.box`, shape (8, 3); the bits of an index select the sides."""
    sides = np.array([[(k >> axis & 1) - 0.5 for axis in range(3)] for k in range(8)]) * box[3:6]
    c, s = np.cos(box[6]), np.sin(box[6])
    turned = np.stack([c * sides[:, 0] - s * sides[:, 1], s * sides[:, 0] + c * sides[:, 1], sides[:, 2]], axis=1)
    return np.asarray(box[:3] + turned, dtype=np.float64)


def project(p_WQ: npt.ArrayLike, T_world_camera: Float64Array, calibration: Calibration) -> Float64Array:
    """Pixels (u, v) of world points through the lens of an episode, pixel centres at +0.5.

    Args:
        p_WQ: Points [m], shape (N, 3).
        T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
        calibration: The camera.

    Returns:
        Pixels, shape (N, 2); nan for points less than 0.1 m ahead of the camera.
    """
    p_CQ = (np.asarray(p_WQ, dtype=np.float64) - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    ahead = p_CQ[:, 2] > NEAR_M
    pixels = np.full((len(p_CQ), 2), np.nan)
    if not ahead.any():
        return pixels
    no_turn, K, D = np.zeros(3), calibration.K_px, np.array(calibration.distortion)
    points = np.ascontiguousarray(p_CQ[ahead][:, None])
    if calibration.distortion_model == "kannala_brandt":
        found, _ = cv2.fisheye.projectPoints(points, no_turn, no_turn, K, D)
    else:
        found, _ = cv2.projectPoints(points, no_turn, no_turn, K, D)
    pixels[ahead] = found[:, 0]
    return pixels


def _ahead_m(dataset: Dataset, index: int) -> float:
    """Distance of the nearest human who is well within the view of a sample; inf without one."""
    x_m, y_m, _, yaw_rad = dataset.poses[index].tolist()
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    offset = dataset.joints_m(index)[:, 0, :2] - (x_m, y_m)
    forward, left = c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0]
    in_view = (forward > NEAREST_SHOWN_M) & (np.abs(left) < 0.7 * forward)
    return float(forward[in_view].min(initial=np.inf))


def _to_fixed_point(pixel: Float64Array) -> tuple[int, int]:
    """A pixel position in OpenCV's convention (integer centres), in sixteenths of a pixel."""
    u, v = np.clip((pixel - 0.5) * (1 << _SUBPIXEL_BITS), -(2**20), 2**20)
    return round(float(u)), round(float(v))


def _lines(
    picture: UInt8Array, points: Float64Array, pairs: Sequence[tuple[int, int]], colour: Rgb, width_px: int
) -> None:
    for a, b in pairs:
        if np.isfinite(points[[a, b]]).all():
            cv2.line(
                picture,
                _to_fixed_point(points[a]),
                _to_fixed_point(points[b]),
                colour,
                width_px,
                cv2.LINE_AA,
                _SUBPIXEL_BITS,
            )


def _dots(picture: UInt8Array, points: Float64Array, colour: Rgb, radius_px: float) -> None:
    for point in points[np.isfinite(points).all(axis=1)]:
        radius = round(radius_px * (1 << _SUBPIXEL_BITS))
        cv2.circle(picture, _to_fixed_point(point), radius, colour, cv2.FILLED, cv2.LINE_AA, _SUBPIXEL_BITS)
