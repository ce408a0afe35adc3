"""Poses that make markers squares of one size, where images share little besides markers."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from readygo.common.arrays import Float64Array
from readygo.services.reconstructor.metric.markers import MarkerSighting
from readygo.services.reconstructor.metric.scale import square_corners_m
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.poses.joining import marker_corners
from readygo.services.reconstructor.similarity import umeyama

_ERROR_PX = 1.0
"""Corners that miss by more count less [px]."""


def adjusted_by_squares(
    lens: PosedImages,
    poses: Mapping[str, Float64Array],
    sightings: Sequence[MarkerSighting],
    *,
    fixed_lens: bool = False,
) -> tuple[dict[str, Float64Array], float]:
    """Poses of the images that show markers, and a factor of the focal length, with the least error of corners.

    Every marker is a square of the same size, which free points do not know: a board's parts keep their scale.

    Args:
        lens: A piece whose first camera is that of all images.
        poses: Rough, by image, shape (4, 4).
        sightings: Markers of one size.
        fixed_lens: True keeps the focal length: its factor is 1.

    Returns:
        Poses by image; those that show no marker are left out.

    Source: Triggs et al., Bundle adjustment, 2000; the markers' poses replace the points.
    """
    corners = marker_corners(lens, dict(poses), sightings)
    seen = [each for each in sightings if each.image in poses and each.marker in corners]
    names, markers = sorted({each.image for each in seen}), sorted({each.marker for each in seen})
    side = float(np.median([np.linalg.norm(c - np.roll(c, -1, axis=0), axis=1) for c in corners.values()]))
    square = square_corners_m(side)
    fits = [umeyama(square, corners[marker]) for marker in markers]
    T = np.linalg.inv(np.stack([poses[name] for name in names]))
    start = np.concatenate(
        [
            [0.0],
            _pack_pose(T[:, :3, :3], T[:, :3, 3]).ravel(),
            _pack_pose(np.stack([f.R for f in fits]), np.stack([f.t for f in fits])).ravel(),
        ]
    )
    image = np.array([names.index(each.image) for each in seen])
    marker = np.array([markers.index(each.marker) for each in seen])
    rays = np.stack([lens.rays(0, each.corners_px) for each in seen])
    changes = 0.0 if fixed_lens else 1.0

    def errors_px(values: Float64Array) -> Float64Array:
        all_poses = np.concatenate([start[1:7], values[1:]]).reshape(-1, 6)
        R, t = _unpack_poses(all_poses[: len(names)])
        R_marker, t_marker = _unpack_poses(all_poses[len(names) :])
        world = np.einsum("sij,cj->sci", R_marker[marker], square) + t_marker[marker][:, None]
        local = np.einsum("sij,scj->sci", R[image], world) + t[image][:, None]
        error_px = lens.focal_px[0] * (np.exp(changes * values[0]) * local[..., :2] / local[..., 2:] - rays)
        return np.asarray(error_px, dtype=np.float64).ravel()

    # The first image stays where it is.
    free = np.concatenate([start[:1], start[7:]])
    found = least_squares(errors_px, free, loss="soft_l1", f_scale=_ERROR_PX, x_scale="jac").x
    R, t = _unpack_poses(np.concatenate([start[1:7], found[1:]]).reshape(-1, 6)[: len(names)])
    result = np.tile(np.eye(4), (len(names), 1, 1))
    result[:, :3, :3], result[:, :3, 3] = np.swapaxes(R, 1, 2), -np.einsum("vji,vj->vi", R, t)
    return dict(zip(names, result, strict=True)), float(np.exp(changes * found[0]))


def _pack_pose(R: Float64Array, t: Float64Array) -> Float64Array:
    return np.column_stack([Rotation.from_matrix(R).as_rotvec(), t])


def _unpack_poses(values: Float64Array) -> tuple[Float64Array, Float64Array]:
    return Rotation.from_rotvec(values[:, :3]).as_matrix(), values[:, 3:]
