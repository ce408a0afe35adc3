"""Images and pieces of a map that share markers only: placed by the markers' corners. Arrays, no COLMAP."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from readygo.common.arrays import Float64Array
from readygo.services.reconstructor.metric.markers import MarkerSighting
from readygo.services.reconstructor.metric.scale import square_corners_m
from readygo.services.reconstructor.metric.triangulate import triangulate
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.similarity import Similarity, umeyama

Corners = dict[int, Float64Array]
"""Corners of markers by id, shape (4, 3) each."""

_PIECE_ERROR_MAX = 0.03
"""Corners of markers that two pieces share may differ by this, as share of a side; else one of the pieces is bent."""
_ERROR_MAX = 0.005
"""Corners may miss by this in the mean, as share of the image's longer side, for an image to be placed by them."""


def placed_by_markers(pieces: Sequence[PosedImages], sightings: Sequence[MarkerSighting]) -> dict[str, Float64Array]:
    """Poses of all images that markers tie to the first piece, by name; shape (4, 4) each, in its frame.

    A piece that shares markers with what is placed already is moved there as a whole; an image that is in no piece is
    placed by the corners that it sees. Both steps repeat until nothing more can be placed.

    Args:
        pieces: Of a map, the largest first.
        sightings: Markers in the images, with poses or without.
    """
    poses = dict(zip(pieces[0].names, pieces[0].T_world_camera, strict=True))
    by_image: dict[str, list[MarkerSighting]] = {}
    for sighting in sightings:
        by_image.setdefault(sighting.image, []).append(sighting)
    while True:
        corners = marker_corners(pieces[0], poses, sightings)
        new = dict(_of_pieces(pieces[1:], poses, corners, sightings)) or dict(
            _of_images(pieces[0], poses, corners, by_image)
        )
        if not new:
            return poses
        poses |= new


def marker_corners(lens: PosedImages, poses: dict[str, Float64Array], sightings: Sequence[MarkerSighting]) -> Corners:
    """Corners of the markers that posed images show; where that is one image, by the size that the others have.

    Args:
        lens: A piece whose first camera is that of all images.
        poses: By image.
        sightings: Of markers, all of one size.
    """
    seen: dict[int, list[MarkerSighting]] = {}
    for sighting in sightings:
        if sighting.image in poses:
            seen.setdefault(sighting.marker, []).append(sighting)
    found = {}
    for marker, several in sorted(seen.items()):
        corners = _seen_often(lens, poses, several) if len(several) > 1 else None
        if corners is not None:
            found[marker] = corners
    if not found:
        return found
    side = float(np.median([np.linalg.norm(c - np.roll(c, -1, axis=0), axis=1) for c in found.values()]))
    once = {
        marker: _seen_once(lens, poses, several[0], side) for marker, several in seen.items() if marker not in found
    }
    return found | {marker: corners for marker, corners in once.items() if corners is not None}


def _seen_often(lens: PosedImages, poses: dict[str, Float64Array], seen: list[MarkerSighting]) -> Float64Array | None:
    rays = np.stack([lens.rays(0, each.corners_px) for each in seen])
    T = np.stack([poses[each.image] for each in seen])
    focal_px = np.full(len(seen), lens.focal_px[0])
    try:
        return np.stack([triangulate(rays[:, corner], T, focal_px).point for corner in range(4)])
    except (ValueError, np.linalg.LinAlgError):
        return None


def _seen_once(
    lens: PosedImages, poses: dict[str, Float64Array], seen: MarkerSighting, side: float
) -> Float64Array | None:
    square = square_corners_m(side)
    T_marker_camera = pose_of_points(square, lens.rays(0, seen.corners_px), _error_max(lens))
    if T_marker_camera is None:
        return None
    T = poses[seen.image] @ np.linalg.inv(T_marker_camera)
    return np.asarray(square @ T[:3, :3].T + T[:3, 3])


def _error_max(lens: PosedImages) -> float:
    """Largest mean error of an image's corners at depth 1."""
    return _ERROR_MAX * float(lens.size_px[0].max()) / float(lens.focal_px[0])


def _of_pieces(
    pieces: Sequence[PosedImages], poses: dict[str, Float64Array], corners: Corners, sightings: Sequence[MarkerSighting]
) -> Iterator[tuple[str, Float64Array]]:
    """Poses of the images of the pieces that share markers with what is placed."""
    for piece in pieces:
        if all(name in poses for name in piece.names):
            continue
        own = marker_corners(piece, dict(zip(piece.names, piece.T_world_camera, strict=True)), sightings)
        shared = sorted(own.keys() & corners.keys())
        if not shared:
            continue
        source, target = np.concatenate([own[m] for m in shared]), np.concatenate([corners[m] for m in shared])
        placed = umeyama(source, target)
        off = np.sqrt(((placed.apply(source) - target) ** 2).sum(axis=1).mean())
        if off > _PIECE_ERROR_MAX * np.linalg.norm(target[0] - target[1]):
            continue
        moved = piece.transform(placed)
        yield from ((n, T) for n, T in zip(moved.names, moved.T_world_camera, strict=True) if n not in poses)


def _of_images(
    lens: PosedImages, poses: dict[str, Float64Array], corners: Corners, by_image: dict[str, list[MarkerSighting]]
) -> Iterator[tuple[str, Float64Array]]:
    """Poses of images that see markers whose corners are known."""
    for name, seen in sorted(by_image.items()):
        known = [each for each in seen if each.marker in corners]
        if name in poses or not known:
            continue
        points = np.concatenate([corners[each.marker] for each in known])
        rays = lens.rays(0, np.concatenate([each.corners_px for each in known]))
        T = pose_of_points(points, rays, _error_max(lens))
        if T is not None:
            yield name, T


def pose_of_points(points: Float64Array, rays: Float64Array, error_max: float) -> Float64Array | None:
    """The pose of a camera that sees points of a plane or of space, shape (4, 4); None if they do not fit.

    Args:
        points: In the world, shape (N, 3), N >= 4.
        rays: Where it sees them, at depth 1, shape (N, 2).
        error_max: Largest root mean square error, at depth 1.
    """
    count, rvecs, tvecs, errors = cv2.solvePnPGeneric(
        points, rays.reshape(-1, 1, 2), np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP
    )
    if not count:
        return None
    best = int(np.argmin(np.ravel(errors)))
    rvec, tvec = cv2.solvePnPRefineLM(points, rays.reshape(-1, 1, 2), np.eye(3), None, rvecs[best], tvecs[best])
    camera_world = Similarity(scale=1.0, R=np.asarray(cv2.Rodrigues(rvec)[0]), t=np.ravel(tvec))
    seen = camera_world.apply(points)
    off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - rays, axis=1)
    if seen[:, 2].min() <= 0.0 or np.sqrt((off**2).mean()) > error_max:
        return None
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = camera_world.R.T, -camera_world.R.T @ camera_world.t
    return T
