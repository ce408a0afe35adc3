"""Reading Gaussians from a file of any known format."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.camera.captured import CapturedViews, load_views
from readygo.common.errors import SceneError
from readygo.common.files import open_regular
from readygo.common.gaussians import splat
from readygo.common.gaussians.checkpoint import (
    TRANSFORMS_FILE,
    ZIP_MAGIC,
    DataTransform,
    cloud_from_checkpoint,
    load_data_transform,
)
from readygo.common.gaussians.cloud import GaussianCloud
from readygo.common.gaussians.compressed_ply import cloud_from_compressed_ply, is_compressed_ply
from readygo.common.gaussians.defects import refusal, unusable, without
from readygo.common.gaussians.output_folder import CAMERAS_FILE, beside, newest_gaussians, ranks
from readygo.common.gaussians.ply import cloud_from_ply, is_surfels
from readygo.common.gaussians.ply_format import read_ply
from readygo.common.gaussians.spz import GZIP_MAGIC, MAGIC, cloud_from_spz
from readygo.common.gaussians.transform import concatenate, transform_cloud

FORMATS = (
    ".ply of 3DGS, 2DGS or PGSR, PlayCanvas .compressed.ply, .splat, .spz, checkpoints of gsplat and nerfstudio, and "
    "the output folders of these"
)
"""What can be read, in words."""

_PROBE_BYTES = 256 * splat.ROW.itemsize


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussianSource:
    """What a file or an output folder holds."""

    cloud: GaussianCloud
    """Its Gaussians with all their numbers, unchecked, in the file's axes and units."""
    file: Path
    """The file that they come from: of a folder, the newest; of several, the first."""
    kind: str
    """What it is, in words."""
    views: CapturedViews | None = None
    """The cameras that it was filmed with, in the same frame."""
    up: Float64Array | None = None
    """Unit vector, up as the cameras were held; None where nothing is known of them."""


def load_gaussians(path: str | Path) -> GaussianCloud:
    """Read Gaussians of any of `FORMATS`; the content decides which it is.

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
    """Read Gaussians of any of `FORMATS`, as `load_gaussians`, but with all numbers unchecked, as the file has them.

    Raises:
        SceneError: If the file is missing, truncated, empty or of another format.
    """
    return read_source(path).cloud


def read_source(path: str | Path) -> GaussianSource:
    """Read a file or a training's output folder, with what is known besides: cameras, and which way was up.

    Gaussians of nerfstudio are moved back from where it trained them to the frame of its data where
    `dataparser_transforms.json` lies beside them.

    Raises:
        SceneError: If it is missing, truncated, empty, or nothing that can be read.
    """
    path = Path(path)
    try:
        source = _read(newest_gaussians(path) if path.is_dir() else path)
    except OSError as error:
        raise SceneError(f"{path} cannot be read: {error.strerror or error}.") from error
    except MemoryError as error:
        raise SceneError(f"{path} holds more Gaussians than this machine has memory for.") from error
    if len(source.cloud) == 0:
        raise SceneError(f"{source.file} is empty: it holds no Gaussians.")
    return source


def _read(file: Path) -> GaussianSource:
    with open_regular(file) as stream:
        start = stream.read(_PROBE_BYTES)
    if start.startswith((GZIP_MAGIC, MAGIC)):
        return GaussianSource(cloud=cloud_from_spz(file), file=file, kind=".spz")
    if start.startswith(ZIP_MAGIC):
        return _checkpoint(file)
    if start.startswith(b"ply"):
        return _ply(file)
    if splat.is_splat(start):
        return _splat(file)
    raise SceneError(f"{file} is none of what can be read: {FORMATS}. Convert it, for example with `splat-transform`.")


def _splat(file: Path) -> GaussianSource:
    size = file.stat().st_size
    if size % splat.ROW.itemsize:
        row = splat.ROW.itemsize
        raise SceneError(f"{file} is truncated: {size} bytes are not a multiple of {row}; copy or export it again.")
    return GaussianSource(cloud=splat.cloud_from_splat(file), file=file, kind=".splat")


def _ply(file: Path) -> GaussianSource:
    tables = read_ply(file)
    if "vertex" not in tables:
        raise SceneError(f"{file} has no element 'vertex', only {sorted(tables)}: it is not a Gaussian file.")
    if len(tables["vertex"]) == 0:
        raise SceneError(f"{file} is empty: it holds no Gaussians.")
    if is_compressed_ply(tables):
        return GaussianSource(cloud=cloud_from_compressed_ply(tables, file), file=file, kind=".compressed.ply")
    cameras = beside(file, CAMERAS_FILE) if file.parent.name.startswith("iteration_") else None
    views = None if cameras is None else load_views(cameras)
    return GaussianSource(
        cloud=cloud_from_ply(tables["vertex"], file),
        file=file,
        kind=".ply of 2DGS" if is_surfels(tables["vertex"]) else ".ply",
        views=views,
        up=None if views is None else views.mean_up,
    )


def _checkpoint(file: Path) -> GaussianSource:
    files = ranks(file)
    parts = [cloud_from_checkpoint(part) for part in files]
    cloud, of_nerfstudio = concatenate([part for part, _ in parts]), parts[0][1]
    kind = "checkpoint of nerfstudio" if of_nerfstudio else "checkpoint of gsplat"
    moves = beside(file, TRANSFORMS_FILE) if of_nerfstudio else None
    if moves is None:
        return GaussianSource(cloud=cloud, file=files[0], kind=kind)
    back = load_data_transform(moves)
    return GaussianSource(cloud=_moved_back(cloud, back), file=files[0], kind=kind, up=back.R[2])


def _moved_back(cloud: GaussianCloud, back: DataTransform) -> GaussianCloud:
    """The inverse of x' = scale (R x + t)."""
    return transform_cloud(cloud, back.R.T, -back.R.T @ back.t, 1.0 / back.scale)


def with_unit_rotations(cloud: GaussianCloud) -> GaussianCloud:
    """The cloud with quaternions of length 1; none may be zero."""
    q = cloud.quats_wxyz.astype(np.float64)
    length = np.sqrt(q[:, 0] * q[:, 0] + q[:, 1] * q[:, 1] + q[:, 2] * q[:, 2] + q[:, 3] * q[:, 3])
    unit: Float32Array = (q / length[:, None]).astype(np.float32)
    return GaussianCloud(
        means_m=cloud.means_m, quats_wxyz=unit, scales_m=cloud.scales_m, opacities=cloud.opacities, sh=cloud.sh
    )
