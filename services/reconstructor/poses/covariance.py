"""How well the matches of a map determine its poses, by COLMAP."""

import math
import tempfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from readygo.services.reconstructor.metric.drift import PoseErrors
from readygo.services.reconstructor.poses.colmap import lens_to_refine, posed_images, pycolmap
from readygo.services.reconstructor.poses.config import PosesConfig

_SQUARE_OF_MEAN = 4.0 / math.pi
"""A point's error is its mean distance: with normal errors its square is so much less than the mean square."""
_ANGLE = 2.0
"""COLMAP's covariances of rotations are those of half their angle, as Ceres changes quaternions."""


def pose_errors(model: Path, names: Collection[str], config: PosesConfig) -> PoseErrors | None:
    """Errors of poses by the residuals of their matches, as if these erred independently; None if they cannot be told.

    COLMAP does not tell those of views that share a centre, as of 360-degree images.

    Three points stand for the frame of the map: only what is left when it is moved, turned and sized means something.

    Args:
        model: A COLMAP model.
        names: Its images whose poses are asked for; what the others add is not counted.
        config: How it was made: a lens that was given and stayed adds no error.

    Source: Triggs et al., Bundle adjustment - a modern synthesis, 2000, section 9; COLMAP's computation of it.
    """
    colmap = pycolmap()
    rec = _only(model, names)
    images = posed_images(rec)
    tracks = [(max(point.error, 0.0), point.track.length()) for point in rec.points3D.values()]
    spare = 2 * sum(count for _, count in tracks) - 3 * len(tracks) - 6 * len(images)
    if len(images) < 2 or spare <= 0 or not all(image.is_ref_in_frame() for image in images):
        return None
    asked_of = colmap.BundleAdjustmentConfig()
    for image in images:
        asked_of.add_image(image.image_id)
    asked_of.fix_gauge(colmap.BundleAdjustmentGauge.THREE_POINTS)
    asked, adjusting = colmap.BACovarianceOptions(), colmap.BundleAdjustmentOptions()
    asked.params, adjusting.print_summary = colmap.BACovarianceOptionsParams.POSES, False
    for name, value in lens_to_refine(config).items():
        setattr(adjusting, name, value)
    adjuster = colmap.create_default_ceres_bundle_adjuster(adjusting, asked_of, rec)
    found = colmap.estimate_ba_covariance(asked, rec, adjuster)
    if found is None:
        return None
    variance = _SQUARE_OF_MEAN * sum(error**2 * count for error, count in tracks) / spare
    ids = [image.image_id for image in images]
    blocks = np.zeros((len(ids), 6, len(ids), 6))
    for a, first in enumerate(ids):
        blocks[a, :, a] = found.get_cam_cov_from_world(first)
        for b, second in enumerate(ids[:a]):
            blocks[a, :, b] = found.get_cam_cross_cov_from_world(first, second)
            blocks[b, :, a] = blocks[a, :, b].T
    units = np.tile([_ANGLE] * 3 + [1.0] * 3, len(ids))
    covariance = variance * units[:, None] * units * blocks.reshape(6 * len(ids), 6 * len(ids))
    if not math.isfinite(float(covariance.sum())):
        return None
    return PoseErrors(names=tuple(image.name for image in images), covariance=covariance)


def _only(model: Path, names: Collection[str]) -> Any:
    """A model without its other images."""
    colmap = pycolmap()
    rec = colmap.Reconstruction(model)
    others = [image for image in map(rec.image, rec.reg_image_ids()) if image.name not in names]
    if not others:
        return rec
    for frame_id in {image.frame_id for image in others}:
        rec.deregister_frame(frame_id)
    # Written and read, they are gone: those without a pose are not adjusted with.
    with tempfile.TemporaryDirectory() as folder:
        rec.write(folder)
        return colmap.Reconstruction(folder)
