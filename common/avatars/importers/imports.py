"""One door for humans from elsewhere."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from readygo.common.array_files import load_npz
from readygo.common.arrays import Float64Array
from readygo.common.avatars.avatar import Avatar
from readygo.common.avatars.importers.assemble import CanonicalHuman, assemble_avatar
from readygo.common.avatars.importers.gaussian_human import gaussian_human
from readygo.common.avatars.importers.gltf_human import GAUSSIAN_COUNT, gltf_human
from readygo.common.avatars.importers.hugs import hugs_human, load_checkpoint
from readygo.common.avatars.importers.kinds import FileKind, kind_of
from readygo.common.avatars.importers.report import ImportReport, SkeletonReport
from readygo.common.avatars.importers.smpl_human import smpl_human
from readygo.common.avatars.importers.smpl_model import load_smpl_model
from readygo.common.errors import AvatarError

GAUSSIAN_LIMITS = 1_000, 500_000
_BETAS_BYTES_MAX = 2**24
"""NeuMan's files have 10 numbers for each of some hundred images."""


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """What comes with a file."""

    license: str
    """Terms under which the human may be used; recorded in the avatar and with every run that shows it."""
    name: str | None = None
    """Name of the avatar; the file's name by default."""
    height_m: float | None = None
    """True height; by default the file's unit is the metre."""
    smpl: Path | None = None
    """SMPL model file of a HUGS checkpoint."""
    betas: Path | None = None
    """.npz with `betas`, the shape of a HUGS or SMPL human; the mean shape by default."""
    weights: Path | None = None
    """.npz that binds the Gaussians of a .ply."""
    gaussians: int = GAUSSIAN_COUNT
    """Wanted number of Gaussians, for humans that are meshes."""

    def __post_init__(self) -> None:
        low, high = GAUSSIAN_LIMITS
        if not self.license.strip():
            raise AvatarError("--license must say under which terms the human may be used, for example 'CC0-1.0'.")
        if not low <= self.gaussians <= high:
            raise AvatarError(f"--gaussians must lie in {low}..{high}, got {self.gaussians}.")
        if self.height_m is not None and not np.isfinite(self.height_m):
            raise AvatarError(f"--height-m must be a finite number, got {self.height_m}.")


def import_human(path: Path, options: ImportOptions) -> tuple[Avatar, ImportReport]:
    """Make an avatar of a file, whose kind is found by its content.

    Args:
        path: HUGS checkpoint, SMPL model, skinned glTF figure, or 3DGS .ply.
        options: What comes with it.

    Returns:
        The avatar, and what was done.

    Raises:
        AvatarError: If the file is of no such kind, is damaged, or something that it needs is missing.
        SceneError: If a .ply is not a Gaussian file.
        OSError: If a file cannot be read.
    """
    kind = kind_of(path)
    human, skeleton, notes = _read(kind, path, options)
    name = options.name or path.stem
    avatar, scale = assemble_avatar(human, name=name, license_text=options.license, height_m=options.height_m)
    report = ImportReport(
        kind=kind.value,
        name=avatar.name,
        license=avatar.license,
        gaussians=len(avatar.cloud),
        height_m=avatar.height_m,
        scale=scale,
        skeleton=skeleton,
        notes=notes,
    )
    return avatar, report


def _read(
    kind: FileKind, path: Path, options: ImportOptions
) -> tuple[CanonicalHuman, SkeletonReport | None, tuple[str, ...]]:
    if kind is FileKind.GLTF:
        return gltf_human(path, height_m=options.height_m, count=options.gaussians)
    if kind is FileKind.GAUSSIANS:
        if options.weights is None:
            raise AvatarError(
                f"{path} holds Gaussians without a skeleton; give the file that binds them with --weights."
            )
        return gaussian_human(path, options.weights), None, ()
    if kind is FileKind.SMPL:
        model = load_smpl_model(path, betas=_betas(options))
        human, notes = smpl_human(model, count=options.gaussians)
        return human, None, notes
    checkpoint = load_checkpoint(path)
    if options.smpl is None:
        raise AvatarError(f"{path} is a HUGS checkpoint; give the SMPL model of its body with --smpl.")
    human, notes = hugs_human(checkpoint, load_smpl_model(options.smpl, betas=_betas(options)))
    if options.betas is None:
        notes = (*notes, "The checkpoint does not hold the body's shape: joints are those of the mean shape.")
    return human, None, notes


def _betas(options: ImportOptions) -> Float64Array | None:
    if options.betas is None:
        return None
    arrays = load_npz(options.betas, ["betas"], bytes_max=_BETAS_BYTES_MAX, raises=AvatarError)
    if "betas" not in arrays or arrays["betas"].dtype.kind not in "fiu" or arrays["betas"].size == 0:
        raise AvatarError(f"{options.betas} holds no betas, the shape coefficients of the body.")
    betas = arrays["betas"].astype(np.float64)
    # NeuMan's files hold a row per image; the shape is the same in all.
    return betas[0].reshape(-1)[:10] if betas.ndim > 1 else betas[:10]
