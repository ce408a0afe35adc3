"""Making scene bundles: from a Gaussian file, or from Gaussians in memory."""

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.camera.captured import CapturedViews, views_text
from readygo.common.config import section_to_mapping
from readygo.common.documents import write_toml
from readygo.common.errors import NoGroundError, SceneError
from readygo.common.files import unfinished_folder
from readygo.common.gaussians import GaussianCloud, R_from_up, save_ply, transform_cloud
from readygo.common.gaussians.defects import HUGE, excessive, refusal, unusable, unwanted_masks, without
from readygo.common.gaussians.files import GaussianSource, read_source, with_unit_rotations
from readygo.common.maps import (
    MapConfig,
    OccupancyMap,
    ScenePlan,
    largest_free_area,
    plan_scene,
    save_ros_map,
    sight_of_cloud,
)
from readygo.common.maps.ros_map import load_unknown_cells
from readygo.common.robot import RobotConfig
from readygo.common.scenes.edit import Box, crop_cloud, mirror_cloud
from readygo.common.scenes.filmed import FILMED_MIN, filmed_share
from readygo.common.scenes.findings import findings
from readygo.common.scenes.manifest import FORMAT, MANIFEST, combined_hash, file_of, grid_digest
from readygo.common.scenes.report import scene_report
from readygo.common.scenes.scene import (
    CLOUD_FILE,
    FILMED_FILE,
    FLOOR_FILE,
    HUMAN_MAP_FILE,
    RECONSTRUCTION_FILE,
    REPORT_FILE,
    ROBOT_MAP_FILE,
    SKY_FILE,
    VIEWS_FILE,
    Scene,
    load_scene,
)
from readygo.common.scenes.survey import UP_OF_CAMERAS, resolve_up

FREE_AREA_MIN_M2 = 1.0
"""A scene whose largest connected free area for the robot is smaller is refused [m2]."""
FRAME = "metres, z up, right-handed"


@dataclass(frozen=True, kw_only=True)
class SceneSource:
    """Where a scene comes from."""

    file: str = ""
    """Name of the file it was imported from; of an output folder, with the way to it from there."""
    kind: str = ""
    """What kind of file that is, in words."""
    sha256: str = ""
    """Hash of that file."""
    up: str = "+z"
    """Axis of the file that points up."""
    scale: float = 1.0
    """Metres per unit of the file."""
    scale_origin: str = ""
    """How the scale was obtained."""
    translate_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Added after turning and scaling [m]."""
    dropped_gaussians: int = 0
    """Gaussians of the files that could not be drawn, or were huge, and were left out."""
    edits: tuple[str, ...] = ()
    """What was done to the scene afterwards: what was cropped, cleaned, turned."""


def import_scene(
    source: str | Path,
    out: str | Path,
    *,
    name: str = "",
    sky: str | Path | None = None,
    up: str = "+z",
    scale: float = 1.0,
    translate_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    license: str = "",
    robot: RobotConfig | None = None,
    resolution_m: float = 0.05,
    opacity_threshold: float = 0.5,
    human_height_m: float = 1.9,
    crop: Box | None = None,
    close_coarse: bool = False,
    mirror: bool = False,
    drop_bad: bool = False,
    close_unfilmed: bool = True,
) -> Scene:
    """Make a scene bundle of a Gaussian file, or of a training's output folder.

    Args:
        source: File or folder of one of `readygo.common.gaussians.files.FORMATS`.
        out: Folder to make; must not exist.
        name: Name of the scene; the folder's by default.
        sky: Gaussians of the far surroundings, in the frame of `source`; by default `sky.ply` of a folder that has one.
        up: Axis of the file that points up: +x, -x, +y, -y, +z or -z; three numbers with commas for a direction;
            "cameras", the mean up of those that it was filmed with; or "auto", which finds it where that is clear.
        scale: Metres per unit of the file.
        translate_m: Added after turning and scaling [m].
        license: Terms of the scene, for everything made from it.
        robot: Footprint and height for the robot map.
        resolution_m: Edge of map cells [m].
        opacity_threshold: Opacity sum above which a voxel is occupied.
        human_height_m: Height of humans for their map [m].
        crop: What is kept of the scene, in metres after moving.
        close_coarse: Keep robot and humans off ground that was not filmed.
        mirror: Take the mirror image of the file.
        drop_bad: Leave out Gaussians that cannot be drawn (`readygo.common.gaussians.defects`) instead of refusing the
            file, and those that are huge; their number is kept in `SceneSource.dropped_gaussians`.
        close_unfilmed: Keep the robot where it sees what was filmed, where the source has cameras.

    Returns:
        The scene.

    Raises:
        SceneError: If the file cannot be used or `out` exists.
        NoGroundError: If the scene has no floor or no free area, or it is not clear which way is up.
    """
    source, out, robot = Path(source), Path(out), robot or RobotConfig()
    _refuse_existing(out)
    if not (math.isfinite(scale) and scale > 0) or not all(map(math.isfinite, translate_m)):
        raise SceneError(f"The scale must be positive and the translation finite, got {scale} and {translate_m}.")
    config = dataclasses.replace(
        _map_config(robot, resolution_m, opacity_threshold, human_height_m),
        close_coarse=close_coarse,
        close_unfilmed=close_unfilmed,
    )
    if sky is None and (source / SKY_FILE).is_file():
        sky = source / SKY_FILE
    held = read_source(source)
    up = _resolved_up(up, held)
    R = R_from_up(up)
    stored = [(source, held.cloud), *([] if sky is None else [(Path(sky), read_source(sky).cloud)])]
    files = [_sound(file, cloud, R, translate_m, scale, drop_bad=drop_bad) for file, cloud in stored]
    cloud, sky_cloud = files[0][0], files[1][0] if sky is not None else None
    dropped = sum(dropped for _, dropped in files)
    if mirror:
        cloud, sky_cloud = mirror_cloud(cloud), None if sky_cloud is None else mirror_cloud(sky_cloud)
    if drop_bad:
        cloud, huge = without(cloud, {HUGE: unwanted_masks(cloud)[HUGE]})
        dropped += huge.get(HUGE, 0)
    if crop is not None:
        cloud = crop_cloud(cloud, crop)
    provenance = SceneSource(
        file=held.file.relative_to(source.parent).as_posix() if source.is_dir() else held.file.name,
        kind=held.kind,
        sha256=file_of(held.file.parent, held.file.name).sha256,
        up=up,
        scale=float(scale),
        scale_origin="as in the file" if scale == 1 else "given on import",
        translate_m=tuple(map(float, translate_m)),
        dropped_gaussians=dropped,
        edits=(*(["mirrored"] if mirror else []), *([] if crop is None else [f"cropped to {crop}"])),
    )
    return save_scene(
        cloud,
        sky_cloud,
        out,
        name=name,
        license=license,
        source=provenance,
        robot=robot,
        map_config=config,
        views=None if held.views is None or mirror else held.views.transform(R, translate_m, scale),
    )


def _resolved_up(up: str, source: GaussianSource) -> str:
    if up == UP_OF_CAMERAS and source.up is None:
        raise SceneError(f"{source.file} comes without cameras that say which way is up; give --up=-y, or --up=auto.")
    return resolve_up(up, lambda: with_unit_rotations(without(source.cloud, unusable(source.cloud))[0]), source.up)


def _sound(
    path: Path, stored: GaussianCloud, R: npt.ArrayLike, translate_m: npt.ArrayLike, scale: float, *, drop_bad: bool
) -> tuple[GaussianCloud, int]:
    """The Gaussians of a file that can be drawn, metres, z up, and the number of the others.

    Raises:
        SceneError: If there are others and `drop_bad` is false, or if none is left.
    """
    usable, counts = without(stored, unusable(stored))
    moved = transform_cloud(with_unit_rotations(usable), R, translate_m, scale)
    cloud, more = without(moved, excessive(moved))
    bad = len(stored) - len(cloud)
    if bad and not drop_bad:
        remedy = "check the scale, or leave them out with --drop-bad"
        raise refusal(str(path), counts | more, bad, len(stored), remedy)
    if len(cloud) == 0:
        raise refusal(str(path), counts | more, bad, len(stored), "export it again")
    return cloud, bad


def save_scene(
    cloud: GaussianCloud,
    sky: GaussianCloud | None,
    out: str | Path,
    *,
    name: str = "",
    license: str = "",
    source: SceneSource | None = None,
    robot: RobotConfig | None = None,
    map_config: MapConfig | None = None,
    views: CapturedViews | None = None,
    reconstruction: Mapping[str, Any] | None = None,
) -> Scene:
    """Make a scene bundle of Gaussians: maps, report, hashes.

    The bundle is built beside `out` and renamed when it is complete.

    Args:
        cloud: Gaussians, metres, z up.
        sky: Gaussians of the far surroundings in the same frame; they take no part in the maps.
        out: Folder to make; must not exist.
        name: Name of the scene; the folder's by default.
        license: Terms of the scene.
        source: Where it comes from.
        robot: Footprint and height for the robot map.
        map_config: How the maps are made; with the robot's height by default.
        views: The cameras that it was filmed with, in the same frame, in their order.
        reconstruction: The report of its reconstruction, as plain values.

    Raises:
        SceneError: If `out` exists, or the scene has no floor or no free area.
    """
    out, robot = Path(out), robot or RobotConfig()
    _refuse_existing(out)
    with unfinished_folder(out, raises=SceneError) as folder:
        fill_bundle(
            folder,
            cloud,
            sky,
            name=name or out.resolve().name,
            license=license,
            source=source or SceneSource(),
            robot=robot,
            map_config=map_config or MapConfig(robot_height_m=robot.height_m),
            views=views,
            reconstruction=reconstruction,
        )
    return load_scene(out)


def fill_bundle(
    folder: Path,
    cloud: GaussianCloud,
    sky: GaussianCloud | None,
    *,
    name: str,
    license: str,
    source: SceneSource,
    robot: RobotConfig,
    map_config: MapConfig,
    views: CapturedViews | None = None,
    reconstruction: Mapping[str, Any] | None = None,
) -> None:
    """Write everything that a bundle consists of into an empty folder; arguments as of `save_scene`.

    Raises:
        SceneError: If the scene has no floor or no free area.
        OSError: If the folder cannot be written.
    """
    plan = plan_scene(cloud, map_config, _places(views))
    _refuse_without_free_area(plan, robot)
    save_ply(cloud, folder / CLOUD_FILE)
    if sky is not None:
        save_ply(sky, folder / SKY_FILE)
    if views is not None:
        (folder / VIEWS_FILE).write_text(views_text(views), encoding="utf-8")
    if reconstruction is not None:
        (folder / RECONSTRUCTION_FILE).write_text(json.dumps(reconstruction, indent=1) + "\n", encoding="utf-8")
    (folder / "maps").mkdir()
    unfilmed = np.zeros_like(plan.unknown)
    if views is not None and len(views):
        share = _filmed_share_map(cloud, plan, views, map_config)
        np.save(folder / FILMED_FILE, share)
        if map_config.close_unfilmed:
            plan, unfilmed = _without_unfilmed(plan, share, robot)
    save_ros_map(plan.robot, folder / ROBOT_MAP_FILE, unknown=plan.unknown | unfilmed)
    save_ros_map(plan.human, folder / HUMAN_MAP_FILE, unknown=plan.unknown)
    np.save(folder / FLOOR_FILE, plan.floor.height_m)
    report = scene_report(cloud, sky, plan.robot, plan.human, plan.floor, robot.planning_radius_m)
    report["findings"] = findings(cloud, plan, report, views)
    (folder / REPORT_FILE).write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    manifest = _manifest(folder, plan, name, license, source, robot, map_config)
    write_toml(folder / MANIFEST, manifest, raises=SceneError)


def plan_of(scene: Scene) -> ScenePlan:
    """All that is known of a bundle's ground, found again; its maps are those that the bundle has.

    Raises:
        SceneError: If the bundle is damaged.
    """
    plan = plan_scene(scene.cloud, scene.maps.config, _places(scene.views))
    robot, human = scene.maps.robot, scene.maps.human
    if robot.frame != plan.robot.frame or robot.occupied.shape != plan.robot.occupied.shape:
        # Another version found another floor.
        return plan
    return dataclasses.replace(plan, robot=robot, human=human, unknown=load_unknown_cells(scene.path / ROBOT_MAP_FILE))


def _places(views: CapturedViews | None) -> Float64Array | None:
    """Centres of the cameras, shape (N, 3) [m]."""
    return None if views is None else views.T_world_camera[:, :3, 3]


def _filmed_share_map(cloud: GaussianCloud, plan: ScenePlan, views: CapturedViews, config: MapConfig) -> Float32Array:
    shape = (plan.robot.occupied.shape[0], plan.robot.occupied.shape[1])
    sight = sight_of_cloud(cloud, plan.floor, plan.robot.frame, shape, config)
    return filmed_share(views, sight, plan.floor, ~plan.robot.occupied)


def _without_unfilmed(plan: ScenePlan, share: Float32Array, robot: RobotConfig) -> tuple[ScenePlan, BoolArray]:
    """The plan that keeps the robot where it sees what was filmed, and the cells that it loses.

    Where too little would be left, cameras say nothing of the place, and it is left as it is.
    """
    unfilmed: BoolArray = (share < FILMED_MIN) & ~plan.robot.occupied
    kept = OccupancyMap(frame=plan.robot.frame, occupied=plan.robot.occupied | unfilmed)
    _, area_m2 = largest_free_area(kept, robot.planning_radius_m)
    if area_m2 < FREE_AREA_MIN_M2:
        return plan, np.zeros_like(unfilmed)
    return dataclasses.replace(plan, robot=kept), unfilmed


def _manifest(
    folder: Path,
    plan: ScenePlan,
    name: str,
    license: str,
    source: SceneSource,
    robot: RobotConfig,
    config: MapConfig,
) -> dict[str, Any]:
    paths = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
    files = {path: file_of(folder, path) for path in paths}
    content = {path: files[path].sha256 for path in (CLOUD_FILE, SKY_FILE) if path in files}
    content["maps/robot"] = grid_digest(plan.robot.occupied, plan.robot.frame)
    content["maps/human"] = grid_digest(plan.human.occupied, plan.human.frame)
    content["maps/floor"] = grid_digest(plan.floor.height_m, plan.floor.frame)
    return {
        "format": FORMAT,
        "name": name,
        "frame": FRAME,
        "license": license,
        "content_hash": combined_hash(content),
        "source": section_to_mapping(source),
        "maps": {**section_to_mapping(config), "planning_radius_m": robot.planning_radius_m},
        "floor": section_to_mapping(plan.floor.frame),
        "content": content,
        "files": {path: {"size": file.size, "sha256": file.sha256} for path, file in files.items()},
    }


def _map_config(robot: RobotConfig, resolution_m: float, opacity_threshold: float, human_height_m: float) -> MapConfig:
    try:
        return MapConfig(
            resolution_m=resolution_m,
            opacity_threshold=opacity_threshold,
            robot_height_m=robot.height_m,
            human_height_m=human_height_m,
        )
    except ValueError as error:
        raise SceneError(str(error)) from error


def _refuse_existing(out: Path) -> None:
    if out.exists() or out.is_symlink():
        raise SceneError(f"{out} exists already; remove it, or choose another folder.")


def _refuse_without_free_area(plan: ScenePlan, robot: RobotConfig) -> None:
    radius_m = robot.planning_radius_m
    _, area_m2 = largest_free_area(plan.robot, radius_m)
    if area_m2 >= FREE_AREA_MIN_M2:
        return
    floor_m2 = float((~plan.unknown).sum()) * plan.robot.frame.resolution_m**2
    clear_m2 = float((~plan.robot.occupied).sum()) * plan.robot.frame.resolution_m**2
    raise NoGroundError(
        f"The scene has no free area for the robot: of {floor_m2:.1f} m2 mapped, {clear_m2:.1f} m2 are clear of "
        f"obstacles, and a disc of radius {radius_m:g} m can move on {area_m2:.1f} m2 ({FREE_AREA_MIN_M2:g} m2 are "
        "needed); check the up axis and the scale."
    )
