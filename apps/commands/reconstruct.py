"""`readygo reconstruct`, `readygo scene poses` and `readygo marker`: make a scene from a video or photos."""

import json as json_module
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from rich.table import Table
from tyro.conf import Fixed, Positional

from readygo.apps.cli import NOTHING_SAVED
from readygo.apps.commands.progress import EVERY_S
from readygo.apps.commands.scene_report import SceneReportOptions, scene_report
from readygo.apps.fleet.reconstruction import ask_worker
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.errors import ConfigError, SceneError
from readygo.common.files import write_whole
from readygo.runs.sections import Keys, Sections, with_file, with_keys
from readygo.services.reconstructor import (
    DEFAULT_DICTIONARY,
    GAUSSIANS,
    PICTURE_FILE,
    POSE_STAGES,
    POSED,
    STAGES,
    FramesConfig,
    Job,
    MetricConfig,
    PosesConfig,
    Preset,
    ReconstructorConfig,
    StageProgress,
    find_poses,
    marker_pdf,
    preset,
    reconstruct_scene,
)

PoseKeys = Annotated[Keys, Sections(frames=FramesConfig, poses=PosesConfig, metric=MetricConfig), Fixed]
ReconstructorKeys = Annotated[Keys, Sections(ReconstructorConfig), Fixed]


@dataclass(frozen=True, kw_only=True)
class FootageOptions:
    """What is known of the images."""

    intrinsics: str = ""
    """The camera's lens, if it is known: a calibration of OpenCV or ROS, a .json of cameras, or "fx fy cx cy [k1 k2 p1
    p2]" in pixels of the upright images; it stays as given, see --poses.intrinsics-are."""
    masks: Path | None = None
    """Folder with a mask of each image, named after it as a.jpg.png, in which 0 is ignored: people who walk through."""
    equirectangular: bool = False
    """The video or photos show 360 degrees, twice as wide as high: they are cut into perspective views."""


@dataclass(frozen=True, kw_only=True)
class ScenePosesOptions:
    """Find camera poses of a video or photos in metres, z up and z = 0 on the floor, without training Gaussians.

    The folder `posed` then holds a COLMAP model with undistorted pinhole images, for any Gaussian trainer. Finished
    stages are kept: run the same command to resume, or with a different marker or length.
    """

    source: Positional[Path]
    """A video, a folder of photos, a folder with a COLMAP model and images/, a transforms.json of nerfstudio, or an
    export of Polycam, Record3D or Stray Scanner."""
    out: Path
    """State folder, new or to resume."""
    marker_size_m: float = 0.0
    """Side of the black square of the printed markers [m]; see `readygo marker`."""
    length: tuple[str, ...] = ()
    """Length between two points picked in two images, "a.jpg:u,v a.jpg:u,v b.jpg:u,v b.jpg:u,v = 2.35", both ends
    in each image [px, m], with _ for spaces in names; with a marker, it checks the marker."""
    scale: float = 0.0
    """Metres per unit of the map, without marker or length."""
    json: bool = False
    """Print the report as JSON."""
    config: Path | None = None
    """TOML file with sections of settings; `--SECTION.KEY VALUE` overrides it."""
    footage: FootageOptions = field(default_factory=FootageOptions)
    keys: PoseKeys = field(default_factory=dict)


def scene_poses(options: ScenePosesOptions) -> None:
    """Find camera poses of a video or photos in metres, z up and z = 0 on the floor, without training Gaussians."""
    config = _config(options, ReconstructorConfig())
    report = find_poses(options.source, options.out, config, Lines(POSE_STAGES).say)
    if options.json:
        sys.stdout.write(json_module.dumps(report) + "\n")
        return
    table = Table(title=f"poses of {options.source.name}", show_header=False)
    for label, text in _rows(report):
        table.add_row(label, text)
    table.add_row("model and images", str(options.out / POSED))
    table.add_row("picture", str(options.out / POSED / PICTURE_FILE))
    PlainConsole().print(table, markup=False)


@dataclass(frozen=True, kw_only=True)
class ReconstructOptions:
    """Make a scene bundle from a video or photos: metric poses, Gaussians, maps.

    Finished stages are kept, and an interrupted training resumes: run the same command.
    """

    source: Positional[Path]
    """A video, a folder of photos, a folder with a COLMAP model and images/, a transforms.json of nerfstudio, or an
    export of Polycam, Record3D or Stray Scanner."""
    out: Path
    """Scene bundle to make; must not exist."""
    marker_size_m: float = 0.0
    """Side of the black square of the printed markers [m]; see `readygo marker`."""
    length: tuple[str, ...] = ()
    """Length between two points picked in two images, "a.jpg:u,v a.jpg:u,v b.jpg:u,v b.jpg:u,v = 2.35", both ends
    in each image [px, m], with _ for spaces in names; with a marker, it checks the marker."""
    scale: float = 0.0
    """Metres per unit of the map, without marker or length."""
    preset: Preset = "draft"
    """draft takes minutes on two cores; standard and high take longer."""
    license: str = ""
    """License of the scene; recorded in everything made from it."""
    work: Path | None = None
    """State folder; OUT.work by default."""
    listen: str = ""
    """Let a `readygo worker reconstructor` do the job that joins at this endpoint, such as tcp/0.0.0.0:7447, on a
    machine with the same paths."""
    json: bool = False
    """Print the report as JSON."""
    config: Path | None = None
    """TOML file with sections of settings; `--SECTION.KEY VALUE` overrides it."""
    footage: FootageOptions = field(default_factory=FootageOptions)
    keys: ReconstructorKeys = field(default_factory=dict)


def reconstruct_command(options: ReconstructOptions) -> None:
    """Make a scene bundle from a video or photos: metric poses, Gaussians, maps."""
    config = _config(options, ReconstructorConfig(gaussians=preset(options.preset)))
    if not options.out.name:
        raise SceneError(f"--out must be the name of a new folder, got {options.out}.")
    if options.listen:
        check_endpoint(options.listen, "--listen")
    job = Job(
        source=options.source,
        out=options.out,
        work=options.work or options.out.with_name(f"{options.out.name}.work"),
        license=options.license,
    )
    lines = Lines(STAGES)
    try:
        report = (
            ask_worker(job, config, options.listen, lines.say)
            if options.listen
            else reconstruct_scene(job, config, lines.say)
        )
    except KeyboardInterrupt:
        # The job removes its folder if no stage in it is finished.
        kept = f"finished stages stay in {job.work}, run the same command again to resume."
        raise KeyboardInterrupt(kept if job.work.exists() else NOTHING_SAVED) from None
    if options.json:
        sys.stdout.write(json_module.dumps(report) + "\n")
        return
    _print_scene(options.source, job, report)
    scene_report(SceneReportOptions(scene=str(options.out)))


def _config(options: ScenePosesOptions | ReconstructOptions, base: ReconstructorConfig) -> ReconstructorConfig:
    """The settings: the base, changed by the file, the options and the keys of the command line.

    Raises:
        ConfigError: If the file cannot be read, or a value is wrong.
    """
    given = {"marker_size_m": options.marker_size_m, "lengths": list(options.length), "scale": options.scale}
    told: dict[str, Any] = {"metric": {name: value for name, value in given.items() if value}}
    if options.footage.intrinsics:
        told["poses"] = {"intrinsics": options.footage.intrinsics}
    frames = {"masks": "" if options.footage.masks is None else str(options.footage.masks)}
    frames["projection"] = "equirectangular" if options.footage.equirectangular else ""
    told["frames"] = {name: value for name, value in frames.items() if value}
    return with_keys(with_keys(with_file(base, options.config), told), options.keys)


class Lines:
    """Progress lines: one when a stage begins, and one every 30 s while it runs."""

    def __init__(self, stages: tuple[str, ...]) -> None:
        """Begin before the first stage.

        Args:
            stages: Names of all stages, in order.
        """
        self._stages, self._stage, self._said_s = stages, "", 0.0
        self._notes = PlainConsole(stderr=True, soft_wrap=True)

    def say(self, progress: StageProgress) -> None:
        """Print a line if the stage is new or the last line is 30 s old."""
        now_s = time.monotonic()
        if progress.stage == self._stage and now_s - self._said_s < EVERY_S:
            return
        number = f"[{self._stages.index(progress.stage) + 1}/{len(self._stages)}]"
        words = f" {100 * progress.share:.0f} %: {progress.words}" if progress.words else " ..."
        self._notes.print(f"{number} {progress.stage}{words}", markup=False)
        self._stage, self._said_s = progress.stage, now_s


def _print_scene(source: Path, job: Job, report: dict[str, Any]) -> None:
    training = report["training"]
    quality = "no images held out"
    if training["psnr_db"] is not None:
        psnr = f"PSNR {training['psnr_db']:.2f} dB ({training['psnr_fitted_db']:.2f} dB with fitted colours)"
        quality = f"{psnr}, SSIM {training['ssim']:.3f} ({len(training['held_out'])} images)"
    table = Table(title=f"{job.out.name}, made of {source.name}", show_header=False)
    for label, text in _rows(report):
        table.add_row(label, text)
    made = f"{training['gaussians']:,} trained on {training['images']} images"
    left = f"unseen: {training['unseen']:,}, {report['removed']}"
    table.add_row("Gaussians", f"{made}; left out: {left}; kept as sky: {report['sky']:,}")
    table.add_row("held-out images", quality)
    for note in training["notes"]:
        table.add_row("note", note)
    for stage, seconds in report["seconds"].items():
        table.add_row(f"time of {stage}", f"{seconds:.0f} s")
    table.add_row("time in all", f"{sum(report['seconds'].values()) / 60.0:.1f} min")
    table.add_row("cameras from above", str(job.work / POSED / PICTURE_FILE))
    table.add_row("held-out pictures", str(job.work / GAUSSIANS / "previews" / "held_out"))
    table.add_row("scene", f"{job.out} (readygo scene inspect {job.out})")
    PlainConsole().print(table, markup=False)


def _rows(report: dict[str, Any]) -> list[tuple[str, str]]:
    verdict, scale = report["verdict"], report["scale"]
    share = f"{100 * verdict['registered_share']:.0f} %"
    interval = scale["interval_percent"]
    known = "interval unknown" if interval is None else f"+-{interval:.2f} % (95 %)"
    rows = [
        ("images", f"{verdict['registered']} of {verdict['images']} have a pose ({share})"),
        ("pieces", " + ".join(map(str, verdict["components"]))),
        ("points", f"{verdict['points']:,}, off by {verdict['reprojection_px']:.2f} px in the mean"),
        ("drift", verdict["drift"]),
        ("scale", f"{scale['metres_per_unit']:.5g} m per unit, {known}, by {scale['source']}"),
        ("up", report["up"]),
    ]
    rows += [
        (f"marker {m['marker']}", f"side {m['side_m']:.4f} m in {m['views']} images, off by {m['residual_px']:.2f} px")
        for m in report["markers"]
    ]
    return [*rows, *(("note", note) for note in report["notes"])]


@dataclass(frozen=True, kw_only=True)
class MarkerOptions:
    """Write a PDF with one marker at true size: print it at 100 %, measure it, and put it on the floor."""

    size_m: float = 0.2
    """Side of the black square [m]."""
    out: Path
    """PDF to write."""
    dictionary: str = DEFAULT_DICTIONARY
    """ArUco or AprilTag dictionary, as OpenCV names it."""
    id: int = 0
    """Id of the marker in the dictionary."""
    page: Literal["A4", "A3", "A2", "letter"] = "A3"
    """Paper size; the marker needs a white border of one cell."""


def marker(options: MarkerOptions) -> None:
    """Write a PDF with one marker at true size: print it at 100 %, measure it, and put it on the floor."""
    if options.out.suffix.lower() != ".pdf":
        raise ConfigError(f"--out {options.out} must end in .pdf.")
    write_whole(options.out, marker_pdf(options.dictionary, options.id, options.size_m, options.page))
    PlainConsole(soft_wrap=True).print(
        f"{options.out}: marker {options.id} of {options.dictionary}, {options.size_m:g} m wide.", markup=False
    )
