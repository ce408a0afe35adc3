"""`readygo scene export`: a scene in the files of other programs."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from readygo.apps.terminal import PlainConsole
from readygo.common.scenes.export import SceneFormat, export_scene
from readygo.runs.scene_argument import open_scene


@dataclass(frozen=True, kw_only=True)
class SceneExportOptions:
    """Write a scene's Gaussians and cameras for other programs, in metres with z up; docs/export.md has the formats.

    `readygo scene import` reads what 3dgs writes, `readygo reconstruct` and `readygo scene poses` what the others do.
    """

    scene: Positional[str]
    """Scene bundle, or "embedded"."""
    format: SceneFormat
    """3dgs: the output folder of a 3DGS training; colmap: a text model, of which opaque Gaussians are the points;
    transforms: nerfstudio's transforms.json."""
    out: Path
    """Folder to make; must not exist."""
    images: Path | None = None
    """Folder with the images of the cameras, such as OUT.work/posed/images of a reconstruction, to copy them too."""


def scene_export(options: SceneExportOptions) -> None:
    """Write a scene's Gaussians and cameras for other programs, in metres with z up."""
    scene = open_scene(options.scene)
    files = export_scene(scene, options.format, options.out, options.images)
    views = 0 if scene.views is None else len(scene.views)
    copied = f", {views} images" if options.images is not None else ""
    PlainConsole(soft_wrap=True).print(
        f"{options.out}: {', '.join(files)}{copied}; {len(scene.cloud):,} Gaussians, {views} cameras.", markup=False
    )
