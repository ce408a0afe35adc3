"""`readygo scene import` and `readygo scene inspect`: make, measure and draw scene bundles."""

import json as json_module
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table
from tyro.conf import Positional

from readygo.apps.pictures.scene_maps import scene_pictures
from readygo.apps.pictures.scene_survey import survey_picture
from readygo.apps.terminal import PlainConsole
from readygo.apps.views.pictures import clarity_map, views_sheet
from readygo.apps.views.scene_findings import findings_map
from readygo.apps.views.views import SceneViews, scene_views, warnings
from readygo.common.arrays import UInt8Array
from readygo.common.drawing.files import write_png
from readygo.common.errors import NoGroundError, ReadygoError, SceneError
from readygo.common.gaussians.defects import FLOATERS, HUGE, Masks, count_kinds, unusable, unwanted_masks, without
from readygo.common.gaussians.files import read_gaussians, with_unit_rotations
from readygo.common.maps import ScenePlan
from readygo.common.robot import RobotConfig, load_robot
from readygo.common.scenes import Scene, import_scene, verify_scene
from readygo.common.scenes.bundle import plan_of
from readygo.common.scenes.edit import crop_box
from readygo.common.scenes.findings import SHARES_WORTH_NAMING, findings
from readygo.common.scenes.report import scene_report
from readygo.common.scenes.survey import Survey, advice, survey, survey_row
from readygo.runs.scene_argument import open_scene

FINDINGS_FILE = "findings.png"


@dataclass(frozen=True, kw_only=True)
class ImportGeometryOptions:
    """Further changes of the geometry and of the maps."""

    translate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Translation after rotation and scaling [m]."""
    crop_z: tuple[float, float] | None = None
    """z0 z1 of the part to keep [m]."""
    close_coarse: bool = False
    """Block unobserved ground for robots and pedestrians: ground that only huge Gaussians represent."""
    keep_unfilmed: bool = False
    """Keep positions from which the robot would see unobserved parts; only if the source has cameras."""
    mirror: bool = False
    """Mirror the scene: for a mirrored file, in which text reads backwards."""


@dataclass(frozen=True, kw_only=True)
class SceneImportOptions:
    """Make a scene bundle (Gaussians, maps, report) from a Gaussian file or from the output of a training.

    The command reports likely defects of the scene, and marks them on its map in inspect/findings.png. If the import
    fails because of the scene, a picture beside OUT and a table show the file's contents, possible up directions and
    possible lengths of its unit, and the error says what to try.
    """

    source: Positional[Path]
    """A .ply of 3DGS, 2DGS or PGSR, a .compressed.ply, .splat or .spz, a checkpoint of gsplat or nerfstudio, or
    the output folder of one of these trainings: its newest iteration and its cameras are read."""
    out: Path
    """Folder to make; must not exist."""
    name: str = ""
    """Name of the scene; the folder's by default."""
    sky: Path | None = None
    """Gaussians of the distant surroundings, in the same frame as the source; sky.ply of a folder by default."""
    up: str = "+z"
    """Axis of the file that points up: +x, +y, +z, -x, -y or -z, written with the equals sign, as in --up=-y; a
    direction such as --up=0.1,-0.99,0.05; "cameras", the mean up direction of the cameras; or "auto", which
    estimates it if it is unambiguous, near the cameras' up direction if there are cameras."""
    scale: float = 1.0
    """Metres per unit of the file."""
    license: str = ""
    """License of the scene; recorded in everything made from it."""
    robot: Path | None = None
    """robot.toml with the height and radius that the maps are made for."""
    resolution: float = 0.05
    """Edge of map cells [m]."""
    crop: tuple[float, float, float, float] | None = None
    """x0 y0 x1 y1 of the part to keep [m], after rotation, scaling and translation."""
    drop_bad: bool = False
    """Drop, and count, Gaussians that cannot be drawn (non-finite numbers, beyond 10 km) or are larger than a
    fifth of the scene."""
    json: bool = False
    """Print one JSON object instead of a table."""
    geometry: ImportGeometryOptions = field(default_factory=ImportGeometryOptions)


def scene_import(options: SceneImportOptions) -> None:
    """Make a scene bundle (Gaussians, maps, report) from a Gaussian file or from the output of a training."""
    chosen = None if options.robot is None else load_robot(options.robot)
    try:
        scene = import_scene(
            options.source,
            options.out,
            name=options.name,
            sky=options.sky,
            up=options.up,
            scale=options.scale,
            translate_m=options.geometry.translate,
            license=options.license,
            robot=chosen,
            resolution_m=options.resolution,
            crop=crop_box(options.crop, options.geometry.crop_z),
            close_coarse=options.geometry.close_coarse,
            close_unfilmed=not options.geometry.keep_unfilmed,
            mirror=options.geometry.mirror,
            drop_bad=options.drop_bad,
        )
    except NoGroundError as error:
        raise SceneError(
            f"{error} {_show_refused_file(options.source, options.out, options.up, options.scale, json=options.json)}"
        ) from error
    seen = scene_views(scene, chosen or RobotConfig())
    report = json_module.loads((scene.path / "report.json").read_text())
    pictures = []
    if report["findings"] or warnings(seen):
        pictures.append(scene.path / "inspect" / FINDINGS_FILE)
        plan = plan_of(scene)
        write_png(pictures[0], _findings(scene, plan, seen, report))
    _print(scene, report, seen, pictures, json=options.json)


@dataclass(frozen=True, kw_only=True)
class SceneInspectOptions:
    """Measure a scene bundle, and draw the scene, its maps and sample views of the robot's camera.

    Map colours: dark is occupied, grey has no visible floor, white is too narrow for the agent, green is the largest
    connected free area, orange areas are disconnected from it. views.png shows the robot's views from positions all
    over the green area, map_views.png the sharpness of these views as colours: orange and brown are blurred.
    findings.png marks likely defects, with labels: rough ground, unobserved ground, positions without a usable view.
    A bundle whose files do not match the hashes in its manifest is refused.
    """

    scene: Positional[str]
    """Scene bundle, "embedded", "embedded:SEED" or "embedded:plan-SEED"."""
    out: Path | None = None
    """Folder for the pictures; the bundle's inspect/ by default."""
    radius: float | None = None
    """Radius of the robot's disc [m]; by default the one that the scene was imported for."""
    robot: Path | None = None
    """robot.toml with the camera of the sample views."""
    json: bool = False
    """Print one JSON object instead of a table."""


def scene_inspect(options: SceneInspectOptions) -> None:
    """Measure a scene bundle, and draw the scene, its maps and sample views of the robot's camera."""
    bundle = open_scene(options.scene)
    radius_m = float(bundle.metadata["maps"]["planning_radius_m"]) if options.radius is None else options.radius
    if not radius_m > 0:
        raise SceneError(f"--radius must be positive, got {radius_m}.")
    verify_scene(bundle)
    maps = bundle.maps
    report = scene_report(bundle.cloud, bundle.sky, maps.robot, maps.human, maps.floor, radius_m)
    plan = plan_of(bundle)
    report["findings"] = findings(bundle.cloud, plan, report, bundle.views)
    folder = bundle.path / "inspect" if options.out is None else options.out
    folder.mkdir(parents=True, exist_ok=True)
    seen = scene_views(bundle, RobotConfig() if options.robot is None else load_robot(options.robot), radius_m=radius_m)
    pictures = {
        **scene_pictures(bundle, radius_m),
        "views.png": views_sheet(seen, bundle.name),
        "map_views.png": clarity_map(seen, maps.robot, radius_m),
        FINDINGS_FILE: _findings(bundle, plan, seen, report),
    }
    for file, picture in pictures.items():
        write_png(folder / file, picture)
    _print(bundle, report, seen, [folder / file for file in pictures], json=options.json)
    if not options.json:
        PlainConsole().print("All files match the hashes of the manifest.")


def _findings(scene: Scene, plan: ScenePlan, seen: SceneViews, report: dict[str, Any]) -> UInt8Array:
    sentences = [*report["findings"], *warnings(seen)]
    return findings_map(plan, seen, sentences, scene.name, float(report["robot"]["radius_m"]))


def _show_refused_file(source: Path, out: Path, up: str, scale: float, *, json: bool) -> str:
    """Write a picture and print a table of a file that cannot be imported; returns their place and what to try."""
    stored = read_gaussians(source)
    usable, _ = without(stored, unusable(stored))
    cloud = with_unit_rotations(usable)
    masks = unwanted_masks(cloud)
    seen, _ = without(cloud, {HUGE: masks[HUGE]})
    found = survey(seen)
    picture = out.with_name(f"{out.name}-survey.png")
    try:
        write_png(picture, survey_picture(seen, found, source.name))
        where = f"What the file holds: {picture}."
    except ReadygoError as trouble:
        # Why the scene cannot be imported matters more than its picture.
        where = str(trouble)
    if json:
        sys.stdout.write(json_module.dumps({**survey_row(found), "picture": str(picture)}) + "\n")
    else:
        table = Table(title=f"what {source.name} holds", show_header=False)
        for label, text in _survey_rows(found, count_kinds(masks)):
            table.add_row(label, text)
        PlainConsole().print(table, markup=False)
    return f"{_remedy(found, up, scale, masks, source)} {where}"


def _remedy(found: Survey, up: str, scale: float, masks: Masks, source: Path) -> str:
    """Advice in words on what to try after an import failed."""
    words = advice(found, up, scale)
    if masks[HUGE].any():
        words += f" {int(masks[HUGE].sum())} of its Gaussians are huge and cover all: --drop-bad leaves them out."
    if float(masks[FLOATERS].mean()) > SHARES_WORTH_NAMING[FLOATERS]:
        clean = source.with_name(f"{source.stem.split('.')[0]}-clean.ply")
        words = (
            f"{int(masks[FLOATERS].sum()):,} of its {found.gaussians:,} Gaussians float and may fill it: "
            f"`readygo scene clean {source} --out {clean}` removes them. {words}"
        )
    return words


def _survey_rows(found: Survey, unwanted_words: str) -> list[tuple[str, str]]:
    rows = [("Gaussians", f"{found.gaussians:,}; unwanted: {unwanted_words}")]
    rows += [
        (f"extent along {axis} (98 %)", f"{low:.4g} .. {high:.4g} units of the file")
        for axis, low, high in zip("xyz", found.low, found.high, strict=True)
    ]
    for up in found.likely_ups:
        room = "" if up.ceiling is None else f", ceiling {up.ceiling:.3g} above it"
        text = (
            f"floor at {up.floor:.3g}{room}; {100 * up.above:.0f} % of the scene above it; score {1000 * up.score:.1f}"
        )
        rows.append((f"--up={up.name}", text))
    return rows + [(f"--scale {scale.metres_per_unit:.3g}", scale.reason) for scale in found.scales]


def _print(scene: Scene, report: dict[str, Any], seen: SceneViews, pictures: list[Path], *, json: bool) -> None:
    if json:
        head: dict[str, Any] = {"name": scene.name, "path": str(scene.path), "content_hash": scene.content_hash}
        head["license"] = scene.license
        head["dropped_gaussians"] = _dropped_count(scene)
        head["cameras"] = 0 if scene.views is None else len(scene.views)
        row = {**head, **report, "views": seen.to_mapping(), "pictures": [str(path) for path in pictures]}
        sys.stdout.write(json_module.dumps(row) + "\n")
        return
    table = Table(title=f"scene {scene.name}", show_header=False)
    for label, text in _rows(report):
        table.add_row(label, text)
    table.add_row("robot's views", _view_summary(seen))
    if _dropped_count(scene):
        table.add_row("left out", f"{_dropped_count(scene):,} Gaussians that cannot be drawn")
    for sentence in report.get("findings", []):
        table.add_row("look here", sentence)
    if scene.views is not None:
        table.add_row("filmed by", f"{len(scene.views):,} cameras")
    table.add_row("license", scene.license or "not given")
    table.add_row("bundle", str(scene.path))
    for path in pictures:
        table.add_row("picture", str(path))
    PlainConsole().print(table)
    console = PlainConsole(stderr=True, soft_wrap=True)
    for text in warnings(seen):
        console.print(f"Warning: {text}", markup=False)


def _view_summary(seen: SceneViews) -> str:
    return (
        f"sharpness {seen.sharpness:.0f}, surface {100 * seen.coverage:.0f} % of the view "
        f"(medians of {len(seen.places)} places)"
    )


def _dropped_count(scene: Scene) -> int:
    return int(scene.metadata.get("source", {}).get("dropped_gaussians", 0))


def _rows(report: dict[str, Any]) -> list[tuple[str, str]]:
    size_m = [high - low for low, high in zip(report["extent_low_m"], report["extent_high_m"], strict=True)]
    floor = report["floor"]
    rows = [
        ("Gaussians", f"{report['gaussians']:,}, SH degree {report['sh_degree']}; sky {report['sky_gaussians']:,}"),
        ("extent (99 %)", f"{size_m[0]:.1f} x {size_m[1]:.1f} x {size_m[2]:.1f} m"),
        (
            "opacity",
            f"median {report['opacity_median']:.2f}; below 0.1: {100 * report['opacity_below_0p1_share']:.0f} %",
        ),
        ("floor", f"z {floor['low_m']:.2f}..{floor['high_m']:.2f} m, tilt {floor['tilt_deg']:.2f} deg"),
    ]
    for agent in ("robot", "human"):
        area = report[agent]
        reachable, clear = f"{area['reachable_m2']:.1f} m2 connected", f"{area['free_m2']:.1f} m2 clear"
        rows.append((f"{agent} area", f"{reachable} for a disc of {area['radius_m']:g} m; {clear}"))
    return rows
