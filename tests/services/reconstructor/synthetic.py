"""Cameras that walk around a marker on a floor, with what they see of points, exactly or with noise."""

from pathlib import Path

import cv2
import numpy as np

from readygo.common.arrays import Float64Array
from readygo.services.reconstructor.metric.markers import MarkerSighting
from readygo.services.reconstructor.metric.scale import square_corners_m
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.similarity import Similarity

FOCAL_PX, WIDTH_PX, HEIGHT_PX = 600.0, 800, 600
MIDDLE_PX = np.array([WIDTH_PX / 2, HEIGHT_PX / 2])
CURVATURE = 0.05
"""Of the lens: x_distorted = x (1 + CURVATURE r^2)."""


def looking(centre: Float64Array, at: Float64Array) -> Float64Array:
    """A level camera's pose."""
    z = (at - centre) / np.linalg.norm(at - centre)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([x, np.cross(z, x), z]), centre
    return T


def ring(count: int = 12, *, radius_m: float = 1.5, height_m: float = 1.4) -> Float64Array:
    """Poses around the origin, shape (count, 4, 4)."""
    angles = np.linspace(0.0, 1.5 * np.pi, count)
    centres = np.column_stack([radius_m * np.cos(angles), radius_m * np.sin(angles), np.full(count, height_m)])
    return np.stack([looking(centre, np.zeros(3)) for centre in centres])


def projected(T_world_camera: Float64Array, points: Float64Array) -> Float64Array:
    """Where a camera sees points through its lens, shape (N, 2) [px]."""
    seen = (points - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    xy = seen[:, :2] / seen[:, 2:]
    return FOCAL_PX * xy * (1.0 + CURVATURE * (xy**2).sum(axis=1, keepdims=True)) + MIDDLE_PX


def undistorted(view: int, pixels: Float64Array) -> Float64Array:
    """Rays of pixels: the lens solved by iteration."""
    bent = (np.asarray(pixels) - MIDDLE_PX) / FOCAL_PX
    xy = bent.copy()
    for _ in range(50):
        xy = bent / (1.0 + CURVATURE * (xy**2).sum(axis=1, keepdims=True))
    return xy


def mapped(T_world_camera: Float64Array, points_m: Float64Array, map_from_world: Similarity) -> PosedImages:
    """A perfect map of cameras that all see all points, in units of its own."""
    count, total = len(T_world_camera), len(points_m)
    seen = np.array([(v, p) for p in range(total) for v in range(count)], dtype=np.int64).reshape(-1, 2)
    return PosedImages(
        names=tuple(f"{number:06d}.jpg" for number in range(count)),
        T_world_camera=map_from_world.moved_poses(T_world_camera),
        focal_px=np.full(count, FOCAL_PX),
        size_px=np.tile([WIDTH_PX, HEIGHT_PX], (count, 1)),
        rays=undistorted,
        points=map_from_world.apply(points_m),
        points_rgb=np.full((total, 3), 120, dtype=np.uint8),
        seen=seen,
        errors_px=np.full(total, 0.3),
    )


def sighted(
    T_world_camera: Float64Array, corners_m: Float64Array, marker: int, noise_px: float = 0.0
) -> list[MarkerSighting]:
    """A marker as all cameras see it."""
    rng = np.random.default_rng(marker)
    return [
        MarkerSighting(
            image=f"{number:06d}.jpg",
            marker=marker,
            corners_px=projected(T, corners_m) + rng.normal(0.0, noise_px, (4, 2))
            if noise_px
            else projected(T, corners_m),
        )
        for number, T in enumerate(T_world_camera)
    ]


def floor_points(count: int = 300) -> Float64Array:
    """Points on the floor and some above it [m]."""
    rng = np.random.default_rng(5)
    floor = np.column_stack([rng.uniform(-2, 2, (count, 2)), np.zeros(count)])
    above = rng.uniform([-2, -2, 0.1], [2, 2, 1.0], (count // 3, 3))
    return np.concatenate([floor, above])


def some_similarity() -> Similarity:
    """From metres to units of a map that lies askew."""
    R = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    return Similarity(scale=0.37, R=R * np.sign(np.linalg.det(R)), t=np.array([1.0, -2.0, 0.5]))


def marker_at(xyz_m: tuple[float, float, float] = (0.0, 0.0, 0.0), size_m: float = 0.2) -> Float64Array:
    """Corners of a marker that lies flat [m]."""
    return square_corners_m(size_m) + np.array(xyz_m)


def synthetic_database(folder: Path, *, matches_of_last: int = 80) -> None:
    """A database of features that match exactly, the map that they come from, and five images without content.

    Args:
        folder: Where `database.db`, `sparse/` and `images/` are written.
        matches_of_last: Of the last image with each other one, of the same points; others have 80.
    """
    import pycolmap

    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = 1, 1, 5, 80
    options.camera_width, options.camera_height, options.camera_params = 160, 120, [150.0, 80.0, 60.0, 0.02]
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(folder / "database.db") as db:
        rec = pycolmap.synthesize_dataset(options, db)
        *others, last = sorted(rec.images)
        for other in others:
            geometry = db.read_two_view_geometry(other, last)
            rows = geometry.inlier_matches
            geometry.inlier_matches = rows[rows[:, 1].argsort()[:matches_of_last]]
            db.delete_two_view_geometry(other, last)
            db.write_two_view_geometry(other, last, geometry)
    (folder / "sparse").mkdir()
    rec.write(folder / "sparse")
    for image in rec.images.values():
        path = folder / "images" / image.name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path.with_suffix(".png")), np.full((120, 160, 3), 90, np.uint8))
        path.with_suffix(".png").rename(path)


def photos(folder: Path, count: int) -> Path:
    """A folder of grey photos."""
    folder.mkdir(exist_ok=True)
    for number in range(count):
        cv2.imwrite(str(folder / f"{number}.jpg"), np.full((60, 80, 3), 90, np.uint8))
    return folder
