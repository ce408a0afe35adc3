"""A scene's Gaussians and cameras in the files of other programs."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.camera.captured import CapturedViews, views_text
from readygo.common.camera.written import IMAGES, TRANSFORMS_FILE, colmap_texts, transforms_text
from readygo.common.errors import SceneError
from readygo.common.files import unfinished_folder
from readygo.common.gaussians import GaussianCloud, save_ply
from readygo.common.gaussians.output_folder import CAMERAS_FILE
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.scenes.scene import SKY_FILE, Scene

SceneFormat = Literal["3dgs", "colmap", "transforms"]
POINTS_MAX = 100_000
"""Most points of a COLMAP model; of more Gaussians so many are taken, evenly."""
_OPACITY_MIN = 0.5
CLOUD_FILE = "point_cloud/iteration_{steps}/point_cloud.ply"


def export_scene(scene: Scene, kind: SceneFormat, out: Path, images: Path | None = None) -> list[str]:
    """Write a scene for other programs, in its own frame: metres, z up.

    Args:
        scene: What to write.
        kind: `3dgs`: the output folder of a 3DGS training, with `cameras.json`, and the sky as `sky.ply`; `colmap`: a
            text model whose points are opaque Gaussians; `transforms`: a `transforms.json`.
        out: Folder to make.
        images: Folder with the images of the cameras, which are copied to `images/`.

    Returns:
        The files that were written, relative to `out`, without the images.

    Raises:
        SceneError: If the scene has no cameras and the format needs them, an image is missing, or `out` exists.
    """
    if out.exists() or out.is_symlink():
        raise SceneError(f"{out} exists already; remove it, or choose another name.")
    if scene.views is None and (kind != "3dgs" or images is not None):
        raise SceneError(f"{scene.path} has no cameras; --format 3dgs without --images writes its Gaussians alone.")
    found = [] if images is None or scene.views is None else _images(scene.views, images)
    write: Callable[[Scene, Path], list[str]] = {
        "3dgs": _write_3dgs,
        "colmap": _write_colmap,
        "transforms": _write_transforms,
    }[kind]
    with unfinished_folder(out, raises=SceneError) as folder:
        files = write(scene, folder)
        for name, path in found:
            place = folder / IMAGES / name
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, place)
    return files


def _images(views: CapturedViews, folder: Path) -> list[tuple[str, Path]]:
    """Names of the cameras' images, and where they are.

    Raises:
        SceneError: If one is missing, or its name leads out of the folder.
    """
    outside = [name for name in views.images if Path(name).is_absolute() or ".." in Path(name).parts]
    if outside:
        raise SceneError(f"The name of the image {outside[0]!r} leads out of its folder; it is not copied.")
    missing = [name for name in views.images if not (folder / name).is_file()]
    if missing:
        raise SceneError(f"{folder} lacks {len(missing)} images of the scene's cameras, {missing[0]} among them.")
    return [(name, folder / name) for name in views.images]


def _write_3dgs(scene: Scene, folder: Path) -> list[str]:
    report = scene.reconstruction or {}
    steps = int(report.get("training", {}).get("settings", {}).get("steps", 0))
    cloud = CLOUD_FILE.format(steps=steps)
    (folder / cloud).parent.mkdir(parents=True)
    save_ply(scene.cloud, folder / cloud)
    files = [cloud]
    if scene.views is not None:
        (folder / CAMERAS_FILE).write_text(views_text(scene.views))
        files.append(CAMERAS_FILE)
    if scene.sky is not None:
        save_ply(scene.sky, folder / SKY_FILE)
        files.append(SKY_FILE)
    return files


def _write_colmap(scene: Scene, folder: Path) -> list[str]:
    assert scene.views is not None
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    texts = colmap_texts(scene.views, *points_of(scene.cloud))
    for name, text in texts.items():
        (model / name).write_text(text)
    return [f"sparse/0/{name}" for name in texts]


def _write_transforms(scene: Scene, folder: Path) -> list[str]:
    assert scene.views is not None
    (folder / TRANSFORMS_FILE).write_text(transforms_text(scene.views))
    return [TRANSFORMS_FILE]


def points_of(cloud: GaussianCloud) -> tuple[Float64Array, UInt8Array]:
    """Centres [m] (P, 3) and colours (P, 3) of opaque Gaussians, at most `POINTS_MAX`, to begin a training with."""
    rows = np.flatnonzero(cloud.opacities >= _OPACITY_MIN)
    rows = rows[:: len(rows) // POINTS_MAX + 1]
    rgb = np.clip(np.rint(255.0 * (0.5 + SH_C0 * cloud.sh[rows, 0].astype(np.float64))), 0, 255)
    return cloud.means_m[rows].astype(np.float64), rgb.astype(np.uint8)
