"""`readygo avatar import`: converts human models of other programs to avatar files."""

import json as json_module
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tyro.conf import Positional

from readygo.apps.avatar.output import check_avatar_out
from readygo.apps.avatar.studio import standing_pose, stride_pose, turntable
from readygo.apps.terminal import PlainConsole
from readygo.common.avatars import Avatar, check_texts, save_avatar
from readygo.common.avatars.importers import ImportOptions, ImportReport, import_human
from readygo.common.drawing.files import write_png
from readygo.services.animator import skeleton_of

_WIDE_SCALES = 10.0
"""Ratio of the largest to the median scale above which 8 bits would coarsen small scales."""


@dataclass(frozen=True, kw_only=True)
class AvatarImportOptions:
    """Convert a human model of another program to an avatar file; the format is detected from the file's content."""

    file: Positional[Path]
    """HUGS checkpoint (.pth), SMPL model (.pkl, .npz), skinned glTF figure (.glb, .gltf, .vrm), or 3DGS .ply."""
    out: Path
    """Avatar file (.npz) to write."""
    license: str
    """License of the model, recorded in the avatar."""
    name: str | None = None
    """Name of the avatar; the file's by default."""
    height_m: float | None = None
    """True height of the person [m]; by default the file's unit is the metre."""
    smpl: Path | None = None
    """SMPL model file (.pkl, .npz) of a HUGS checkpoint."""
    betas: Path | None = None
    """.npz with `betas`, the body's shape, for HUGS and SMPL; the mean shape by default."""
    weights: Path | None = None
    """.npz with lbs_weight (and lbs_index), joints_canonical, optionally joints_tpose, for a .ply."""
    gaussians: int = 40_000
    """Target number of Gaussians for a mesh."""
    preview: bool = False
    """Write a sheet of views beside it, as PNG."""
    json: bool = False
    """Print the report as JSON."""


def avatar_import(options: AvatarImportOptions) -> None:
    """Convert a human model of another program to an avatar file; the format is detected from the file's content."""
    check_avatar_out(options.out, (options.file, options.smpl, options.betas, options.weights))
    check_texts(options.name or options.out.stem, options.license)
    settings = ImportOptions(
        license=options.license,
        name=options.name or options.out.stem,
        height_m=options.height_m,
        smpl=options.smpl,
        betas=options.betas,
        weights=options.weights,
        gaussians=options.gaussians,
    )
    avatar, report = import_human(options.file, settings)
    skeleton_of(avatar)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    save_avatar(avatar, options.out, quantise=not _has_wide_scales(avatar))
    sheet = options.out.with_suffix(".png") if options.preview else None
    if sheet is not None:
        write_png(sheet, turntable(avatar, (standing_pose(), stride_pose())))
    if options.json:
        paths = {"out": str(options.out), "preview": None if sheet is None else str(sheet)}
        sys.stdout.write(json_module.dumps({**report.as_json(), **paths}, indent=2) + "\n")
    else:
        _print_report(report, options.out, sheet)


def _has_wide_scales(avatar: Avatar) -> bool:
    scales = avatar.cloud.scales_m
    return bool(scales.max() > _WIDE_SCALES * np.median(scales.max(axis=1)))


def _print_report(report: ImportReport, out: Path, sheet: Path | None) -> None:
    console = PlainConsole(soft_wrap=True)
    lines = [
        f"{out}: {report.name}, a {report.kind}, {report.height_m:.2f} m tall, {report.gaussians:,} Gaussians",
        f"license: {report.license}",
    ]
    skeleton = report.skeleton
    if skeleton is not None:
        lines.append(f"skeleton, recognised by {skeleton.source}:")
        lines += [f"  {joint:<15} {bone}" for joint, bone in skeleton.bone_of_joint.items()]
        if skeleton.estimated:
            lines.append(f"  estimated: {', '.join(skeleton.estimated)}")
        if skeleton.merged:
            merged = ", ".join(f"{bone} -> {joint}" for bone, joint in skeleton.merged.items())
            lines.append(f"  merged: {merged}")
    lines += report.notes
    if sheet is not None:
        lines.append(f"preview: {sheet}")
    for line in lines:
        console.print(line)
