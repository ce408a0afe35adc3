"""3DGS .ply files: logit opacities, log scales, SH channel by channel; also of PGSR, and of 2DGS with its flat ones."""

from pathlib import Path

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array
from readygo.common.errors import SceneError
from readygo.common.files import write_then_rename
from readygo.common.gaussians.activations import (
    logits_from_opacities,
    logs_from_scales,
    opacities_from_logits,
    scales_from_logs,
)
from readygo.common.gaussians.cloud import GaussianCloud
from readygo.common.gaussians.ply_format import columns, require_fields

POSITION = ["x", "y", "z"]
SH_DC = ["f_dc_0", "f_dc_1", "f_dc_2"]
SCALE = ["scale_0", "scale_1", "scale_2"]
ROTATION = ["rot_0", "rot_1", "rot_2", "rot_3"]
SH_REST_COUNTS = (0, 9, 24, 45)
"""Number of f_rest properties of SH degree 0..3."""
SURFEL_RATIO = 0.01
"""2DGS stores two scales: its Gaussians are discs, whose normal is the third axis. They get a hundredth of the smaller
one as the third, so that covariances can be inverted and the normal is the shortest axis."""


def cloud_from_ply(vertices: AnyArray, path: Path) -> GaussianCloud:
    """Gaussians of a 3DGS vertex table; not validated.

    Raises:
        SceneError: If a property is missing or the number of SH properties fits no degree.
    """
    scale = SCALE[:2] if is_surfels(vertices) else SCALE
    require_fields(vertices, [*POSITION, *SH_DC, "opacity", *scale, *ROTATION], path, "a 3DGS Gaussian file")
    return GaussianCloud(
        means_m=columns(vertices, POSITION),
        quats_wxyz=columns(vertices, ROTATION),
        scales_m=_with_third(scales_from_logs(columns(vertices, scale))),
        opacities=opacities_from_logits(columns(vertices, ["opacity"])[:, 0]),
        sh=sh_from_channels(columns(vertices, SH_DC), columns(vertices, sh_rest_names(vertices, path))),
    )


def is_surfels(vertices: AnyArray) -> bool:
    """True for a vertex table of 2DGS, which has two scales."""
    names = vertices.dtype.names or ()
    return all(name in names for name in SCALE[:2]) and SCALE[2] not in names


def _with_third(scales: Float32Array) -> Float32Array:
    if scales.shape[1] == 3:
        return scales
    return np.concatenate([scales, np.float32(SURFEL_RATIO) * scales.min(axis=1, keepdims=True)], axis=1)


def sh_rest_names(table: AnyArray, path: Path) -> list[str]:
    """The f_rest properties of a table in order.

    Raises:
        SceneError: If their number fits no SH degree, or one is missing.
    """
    count = sum(name.startswith("f_rest_") for name in table.dtype.names or ())
    if count not in SH_REST_COUNTS:
        raise SceneError(f"{path} has {count} f_rest properties; spherical harmonics have 0, 9, 24 or 45.")
    names = [f"f_rest_{i}" for i in range(count)]
    require_fields(table, names, path, "a 3DGS Gaussian file with all its spherical harmonics")
    return names


def sh_from_channels(dc: Float32Array, rest: Float32Array) -> Float32Array:
    """SH coefficients (N, K, 3) of f_dc (N, 3) and channel-major f_rest (N, 3 (K-1))."""
    count, per_channel = len(dc), rest.shape[1] // 3
    sh = np.empty((count, per_channel + 1, 3), np.float32)
    sh[:, 0] = dc
    sh[:, 1:] = rest.reshape(count, 3, per_channel).transpose(0, 2, 1)
    return sh


def save_ply(cloud: GaussianCloud, path: str | Path) -> None:
    """Write a 3DGS .ply that common viewers and `load_gaussians` read.

    Opacities of exactly 0 or 1 are stored as logits of -+40. The file appears under its name only when it is complete.

    Args:
        cloud: What to write.
        path: The file.
    """
    path = Path(path)
    rest = cloud.sh[:, 1:].transpose(0, 2, 1).reshape(len(cloud), -1)
    names = [*POSITION, *SH_DC, *(f"f_rest_{i}" for i in range(rest.shape[1])), "opacity", *SCALE, *ROTATION]
    rows = np.concatenate(
        [
            cloud.means_m,
            cloud.sh[:, 0],
            rest,
            logits_from_opacities(cloud.opacities)[:, None],
            logs_from_scales(cloud.scales_m),
            cloud.quats_wxyz,
        ],
        axis=1,
    )
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    header += [*(f"property float {name}" for name in names), "end_header"]
    with write_then_rename(path, raises=SceneError) as part, part.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode())
        # Unlike tofile it says so when the disk is full.
        file.write(np.ascontiguousarray(rows, dtype="<f4").data)
