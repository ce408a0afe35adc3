"""Reading Gaussians from whatever file holds them."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from readygo.common.errors import SceneError
from readygo.common.gaussians.cloud import GaussianCloud
from readygo.common.gaussians.compressed_ply import cloud_from_compressed_ply, is_compressed_ply
from readygo.common.gaussians.defects import refusal, unusable, without
from readygo.common.gaussians.ply import cloud_from_ply
from readygo.common.gaussians.ply_format import read_ply


def load_gaussians(path: str | Path) -> GaussianCloud:
    """Read a 3DGS .ply or a PlayCanvas .compressed.ply; the header decides which.

    Quaternions are normalised; axes and units stay those of the file.

    Args:
        path: File.

    Returns:
        The Gaussians, all numbers finite.

    Raises:
        SceneError: If the file is missing, truncated, empty, of another format, or holds numbers that are not finite.
    """
    cloud = read_gaussians(path)
    good, counts = without(cloud, unusable(cloud))
    if counts:
        remedy = "import the file with `readygo scene import --drop-bad`, which leaves them out"
        raise refusal(str(path), counts, len(cloud) - len(good), len(cloud), remedy)
    return with_unit_rotations(good)


def read_gaussians(path: str | Path) -> GaussianCloud:
    """As `load_gaussians`, but with whatever numbers the file holds.

    Raises:
        SceneError: If the file is missing, truncated, empty or of another format.
    """
    path = Path(path)
    tables = read_ply(path)
    if "vertex" not in tables:
        raise SceneError(f"{path} has no element 'vertex', only {sorted(tables)}: it is not a Gaussian file.")
    if len(tables["vertex"]) == 0:
        raise SceneError(f"{path} is empty: it holds no Gaussians.")
    if is_compressed_ply(tables):
        return cloud_from_compressed_ply(tables, path)
    return cloud_from_ply(tables["vertex"], path)


def with_unit_rotations(cloud: GaussianCloud) -> GaussianCloud:
    """The cloud with quaternions of length 1; none may be zero."""
    q = cloud.quats_wxyz.astype(np.float64)
    length = np.sqrt(q[:, 0] * q[:, 0] + q[:, 1] * q[:, 1] + q[:, 2] * q[:, 2] + q[:, 3] * q[:, 3])
    unit: npt.NDArray[np.float32] = (q / length[:, None]).astype(np.float32)
    return GaussianCloud(
        means_m=cloud.means_m, quats_wxyz=unit, scales_m=cloud.scales_m, opacities=cloud.opacities, sh=cloud.sh
    )
