"""`readygo scene crop`, `align`, `scale` and `clean`: write a changed copy of a scene."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from tyro.conf import Positional

from readygo.apps.pictures.scene_survey import change_picture
from readygo.apps.terminal import PlainConsole
from readygo.common.camera.captured import CapturedViews
from readygo.common.drawing.files import write_png
from readygo.common.errors import SceneError
from readygo.common.files import write_then_rename
from readygo.common.gaussians import GaussianCloud, load_gaussians, save_ply, transform_cloud
from readygo.common.maps import MapConfig
from readygo.common.robot import RobotConfig
from readygo.common.scenes import SceneSource, save_scene
from readygo.common.scenes.edit import KINDS, clean_cloud, crop_box, crop_cloud, levelling, room_scale
from readygo.runs.scene_argument import open_scene


@dataclass(frozen=True, kw_only=True, eq=False)
class _Original:
    """The scene to edit: a bundle, or a Gaussian file, which must be in metres with z up."""

    cloud: GaussianCloud
    sky: GaussianCloud | None = None
    views: CapturedViews | None = None
    name: str = ""
    license: str = ""
    source: SceneSource = dataclasses.field(default_factory=SceneSource)
    robot: RobotConfig = dataclasses.field(default_factory=RobotConfig)
    config: MapConfig = dataclasses.field(default_factory=MapConfig)
    reconstruction: Mapping[str, Any] | None = None
    """The report of its reconstruction, as far as it holds for what is written."""

    def without_scores(self) -> "_Original":
        """The scene without the scores of its held-out images: all of its Gaussians had them."""
        if self.reconstruction is None or not self.reconstruction.get("training"):
            return self
        scores = dict.fromkeys(("psnr_db", "psnr_fitted_db", "ssim"))
        training = {**self.reconstruction["training"], **scores, "held_out": []}
        return dataclasses.replace(self, reconstruction={**self.reconstruction, "training": training})


@dataclass(frozen=True, kw_only=True)
class SceneCropOptions:
    """Crop a scene, and rebuild its maps."""

    scene: Positional[str]
    """Scene bundle, "embedded", or a Gaussian file in metres, z up."""
    out: Path
    """Folder of the bundle to make, or a .ply file; must not exist. A picture shows before and after."""
    box: tuple[float, float, float, float] | None = None
    """x0 y0 x1 y1 of the part to keep [m]."""
    z: tuple[float, float] | None = None
    """z0 z1 of the part to keep [m]."""


def scene_crop(options: SceneCropOptions) -> None:
    """Crop a scene, and rebuild its maps."""
    part = crop_box(options.box, options.z)
    if part is None:
        raise SceneError("Say what is kept: --box X0 Y0 X1 Y1, --z Z0 Z1, or both.")
    original = _open_original(options.scene, options.out)
    cloud = crop_cloud(original.cloud, part)
    _write(original.without_scores(), cloud, original.sky, options.out, f"cropped to {part}")


@dataclass(frozen=True, kw_only=True)
class SceneAlignOptions:
    """Rotate and shift a scene so that its floor is level and at height 0, and rebuild its maps."""

    scene: Positional[str]
    """Scene bundle, "embedded", or a Gaussian file in metres, z up."""
    out: Path
    """Folder of the bundle to make, or a .ply file; must not exist. A picture shows before and after."""
    up: str = "auto"
    """Direction that points up: an axis, three numbers with commas, or "auto" for the normal of the floor."""


def scene_align(options: SceneAlignOptions) -> None:
    """Rotate and shift a scene so that its floor is level and at height 0, and rebuild its maps."""
    original = _open_original(options.scene, options.out)
    R, translate_m, name = levelling(original.cloud, options.up)
    words = f"turned so that {name} is up, and moved by {translate_m[2]:.3f} m"
    _write_moved(original, options.out, words, {"up": words}, R=R, translate_m=translate_m)


@dataclass(frozen=True, kw_only=True)
class SceneScaleOptions:
    """Scale a scene, and rebuild its maps."""

    scene: Positional[str]
    """Scene bundle, "embedded", or a Gaussian file, z up."""
    out: Path
    """Folder of the bundle to make, or a .ply file; must not exist. A picture shows before and after."""
    factor: float | None = None
    """Factor for all lengths."""
    room_height: float | None = None
    """Height of the ceiling above the floor after scaling [m], instead of `factor`."""


def scene_scale(options: SceneScaleOptions) -> None:
    """Scale a scene, and rebuild its maps."""
    if (options.factor is None) == (options.room_height is None):
        raise SceneError("Give either --factor or --room-height.")
    original = _open_original(options.scene, options.out)
    by = room_scale(original.cloud, options.room_height) if options.room_height is not None else options.factor
    if by is None or not 0 < by < float("inf"):
        raise SceneError(f"The factor must be positive, got {by}.")
    words, source = f"scaled by {by:.4g}", original.source
    scaled = dataclasses.replace(
        source,
        scale=by * float(source.scale),
        scale_origin=f"{source.scale_origin or 'unknown'}, then {words}",
        translate_m=tuple(by * float(value) for value in source.translate_m),
    )
    original = dataclasses.replace(original, source=scaled)
    _write_moved(original, options.out, words, {"scale": _scaled(original.reconstruction or {}, by, words)}, scale=by)


@dataclass(frozen=True, kw_only=True)
class SceneCleanOptions:
    """Remove and count unwanted Gaussians, and rebuild the scene's maps.

    Huge ones are larger than a fifth of the scene; floaters are small isolated groups, and clouds of them around a
    scene; haze is faint and several times larger than usual, as some glass is, too.
    """

    scene: Positional[str]
    """Scene bundle, "embedded", or a Gaussian file in metres, z up."""
    out: Path
    """Folder of the bundle to make, or a .ply file; must not exist. A picture shows before and after."""
    kinds: str = "huge,floaters"
    """Kinds to remove, separated by commas, of huge, floaters and haze; "all" removes all three."""


def scene_clean(options: SceneCleanOptions) -> None:
    """Remove and count unwanted Gaussians, and rebuild the scene's maps."""
    original = _open_original(options.scene, options.out)
    wanted = (
        tuple(KINDS)
        if options.kinds == "all"
        else tuple(word.strip() for word in options.kinds.split(",") if word.strip())
    )
    cloud, counts = clean_cloud(original.cloud, wanted)
    _write(original.without_scores(), cloud, original.sky, options.out, f"cleaned of {counts}")


def _open_original(scene: str, out: Path) -> _Original:
    if out.exists() or out.is_symlink():
        raise SceneError(f"{out} exists already; remove it, or choose another name.")
    if Path(scene).is_file():
        return _Original(cloud=load_gaussians(scene), source=SceneSource(file=Path(scene).name))
    bundle = open_scene(scene)
    known = {field.name for field in dataclasses.fields(SceneSource)}
    source = {key: value for key, value in bundle.metadata.get("source", {}).items() if key in known}
    config = bundle.maps.config
    radius_m = float(bundle.metadata["maps"]["planning_radius_m"])
    robot = RobotConfig(
        height_m=config.robot_height_m, planning_radius_m=radius_m, radius_m=min(RobotConfig().radius_m, radius_m)
    )
    return _Original(
        cloud=bundle.cloud,
        sky=bundle.sky,
        views=bundle.views,
        name=bundle.name,
        license=bundle.license,
        source=SceneSource(**source),
        robot=robot,
        config=config,
        reconstruction=bundle.reconstruction,
    )


def _scaled(report: Mapping[str, Any], by: float, words: str) -> dict[str, Any]:
    """The scale of a reconstruction whose scene is scaled: no measure tells how far that is off."""
    scale = report.get("scale", {})
    unknown = dict.fromkeys(("low", "high", "interval_percent", "drift_percent"))
    metres = by * float(scale.get("metres_per_unit", 1.0))
    return {**scale, **unknown, "metres_per_unit": metres, "source": f"{scale.get('source', 'unknown')}, then {words}"}


def _moved_marker(marker: Mapping[str, Any], R: npt.ArrayLike, translate_m: npt.ArrayLike, scale: float) -> Any:
    """What a report tells of a marker, after x' = scale R x + translate."""
    moved = dict(marker)
    for name in ("side_m", "sides_m"):
        moved[name] = np.round(scale * np.asarray(marker[name]), 5).tolist()
    centre_m = scale * (np.asarray(R, dtype=np.float64) @ np.asarray(marker["centre_m"])) + np.asarray(translate_m)
    return {**moved, "centre_m": np.round(centre_m, 4).tolist()}


def _write_moved(
    original: _Original,
    out: Path,
    words: str,
    told: Mapping[str, Any],
    *,
    R: npt.ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    translate_m: npt.ArrayLike = (0.0, 0.0, 0.0),
    scale: float = 1.0,
) -> None:
    """Write the scene, its sky and its views after x' = scale R x + translate; `told` is what its report says then."""
    cloud = transform_cloud(original.cloud, R, translate_m, scale)
    sky = None if original.sky is None else transform_cloud(original.sky, R, translate_m, scale)
    views = None if original.views is None else original.views.transform(R, translate_m, scale)
    report = original.reconstruction
    if report is not None:
        markers = [_moved_marker(marker, R, translate_m, scale) for marker in report.get("markers", [])]
        notes = [f"before it was {words}: {note}" for note in report.get("notes", [])]
        report = {**report, "markers": markers, "notes": notes, **told}
    _write(dataclasses.replace(original, views=views, reconstruction=report), cloud, sky, out, words)


def _write(original: _Original, cloud: GaussianCloud, sky: GaussianCloud | None, out: Path, words: str) -> None:
    """Write the changed scene and a picture of before and after, and print the change."""
    if out.suffix == ".ply":
        with write_then_rename(out, raises=SceneError) as part:
            save_ply(cloud, part)
        picture = out.with_suffix(".png")
    else:
        source = dataclasses.replace(original.source, edits=(*original.source.edits, words))
        save_scene(
            cloud,
            sky,
            out,
            name=original.name,
            license=original.license,
            source=source,
            robot=original.robot,
            map_config=original.config,
            views=original.views,
            reconstruction=original.reconstruction,
        )
        picture = out / "inspect" / "change.png"
    write_png(picture, change_picture(original.cloud, cloud, words))
    console = PlainConsole(soft_wrap=True)
    console.print(f"{out}: {words}; {len(cloud):,} of {len(original.cloud):,} Gaussians.", markup=False)
    console.print(f"Before and after: {picture}", markup=False)
