"""Output folders of trainings: which files are the newest Gaussians, and what lies beside them.

| training | Gaussians | beside them |
|---|---|---|
| 3DGS, 2DGS, PGSR | `point_cloud/iteration_N/point_cloud.ply` | `cameras.json` |
| nerfstudio | `nerfstudio_models/step-N.ckpt` | `dataparser_transforms.json` |
| gsplat | `ckpts/ckpt_N_rankR.pt`, all ranks, or `ply/point_cloud_N.ply` | |
"""

import re
from pathlib import Path

from readygo.common.errors import SceneError

CAMERAS_FILE = "cameras.json"

_PATTERNS = (
    ("point_cloud/iteration_*/point_cloud.ply", "iteration_*/point_cloud.ply", "point_cloud.ply"),
    ("nerfstudio_models/step-*.ckpt", "step-*.ckpt"),
    ("ckpts/ckpt_*.pt", "ckpt_*.pt"),
    ("ply/point_cloud_*.ply",),
)
"""Patterns of each training's Gaussians, relative to its folder and to the folders below it."""
_STEP = re.compile(r"(?:iteration_|step-|ckpt_|point_cloud_)(\d+)")
_RANK = re.compile(r"(ckpt_\d+_rank)\d+\.pt")


def newest_gaussians(folder: Path) -> Path:
    """The file with the Gaussians of a training's last iteration.

    Args:
        folder: The training's output folder, or one below it.

    Raises:
        SceneError: If there is none.
    """
    for pattern in (pattern for patterns in _PATTERNS for pattern in patterns):
        found = sorted(path for path in folder.glob(pattern) if path.is_file())
        if found:
            return max(found, key=_step)
    wanted = ", ".join(patterns[0] for patterns in _PATTERNS)
    raise SceneError(f"{folder} holds no Gaussians of a training ({wanted}); name the file itself.")


def ranks(file: Path) -> list[Path]:
    """A checkpoint and those of the other processes of the same training and step, which hold the rest of the scene."""
    match = _RANK.fullmatch(file.name)
    if match is None:
        return [file]
    return sorted(file.parent.glob(f"{match[1]}*.pt"), key=lambda path: (len(path.name), path.name))


def beside(file: Path, name: str) -> Path | None:
    """A file of a training's folder, of that name, to a file of Gaussians at its place in this folder."""
    folders = file.parents
    depth = 3 if file.parent.name.startswith("iteration_") else 2
    return next((folder / name for folder in list(folders)[:depth] if (folder / name).is_file()), None)


def _step(path: Path) -> int:
    steps = _STEP.findall(f"{path.parent.name}/{path.name}")
    return int(steps[-1]) if steps else -1
