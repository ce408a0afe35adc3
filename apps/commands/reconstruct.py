"""`readygo reconstruct`, `readygo scene poses` and `readygo marker`: make a scene from a video or photos."""

import json as json_module
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from rich.table import Table

from readygo.apps.commands.progress import EVERY_S
from readygo.apps.commands.scene_report import scene_report
from readygo.apps.fleet.reconstruction import ask_worker
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.errors import ConfigError
from readygo.common.files import write_whole
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.handlers import find_poses
from readygo.services.reconstructor.job import PICTURE_FILE, POSE_STAGES, POSED
from readygo.services.reconstructor.marker_sheet import marker_pdf
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.metric.markers import DEFAULT_DICTIONARY
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.reconstruct import GAUSSIANS, STAGES, Job, reconstruct
from readygo.services.reconstructor.stages import StageProgress
from readygo.services.reconstructor.training.config import Device, GaussiansConfig, Preset
from readygo.services.reconstructor.training.config import preset as settings_of


def scene_poses(
    source: Path,
    /,
    *,
    out: Path,
    marker_size_m: float = 0.0,
    marker_dictionary: str = DEFAULT_DICTIONARY,
    marker_id: tuple[int, ...] = (),
    marker_on: Literal["auto", "floor", "wall"] = "auto",
    length: tuple[str, ...] = (),
    scale: float = 0.0,
    frames: int = 300,
    mapper: Literal["auto", "incremental", "global"] = "auto",
    threads: int = 0,
    json: bool = False,
) -> None:
    """Find camera poses of a video or photos in metres, z up and z = 0 on the floor, without training Gaussians.

    The folder `posed` then holds a COLMAP model with undistorted pinhole images, for any Gaussian trainer. Finished
    stages are kept: run the same command to resume, or with a different marker or length.

    Args:
        source: A video, a folder of photos, or a folder with a COLMAP model and images/.
        out: State folder, new or to resume.
        marker_size_m: Side of the black square of the printed markers [m]; see `readygo marker`.
        marker_dictionary: Dictionary of the markers, as OpenCV names it.
        marker_id: Ids of the markers of that size; all detected ones by default.
        marker_on: Surface on which the markers lie; auto infers it from the camera's orientation.
        length: Length between two points picked in two images, "a.jpg:u,v a.jpg:u,v b.jpg:u,v b.jpg:u,v = 2.35", both
            ends in each image [px, m]; with a marker, it checks the marker.
        scale: Metres per unit of the map, without marker or length.
        frames: Largest number of video frames to use.
        mapper: auto is incremental up to 200 images, global beyond.
        threads: 0 uses all cores; 1 gives the same map each time.
        json: Print the report as JSON.
    """
    metric = _metric(
        marker_size_m=marker_size_m,
        marker_dictionary=marker_dictionary,
        marker_ids=marker_id,
        marker_on=marker_on,
        lengths=length,
        scale=scale,
    )
    report = find_poses(
        source, out, _config(metric, frames, mapper, threads, GaussiansConfig()), Lines(POSE_STAGES).say
    )
    if json:
        sys.stdout.write(json_module.dumps(report) + "\n")
        return
    table = Table(title=f"poses of {source.name}", show_header=False)
    for label, text in _rows(report):
        table.add_row(label, text)
    table.add_row("model and images", str(out / POSED))
    table.add_row("picture", str(out / POSED / PICTURE_FILE))
    PlainConsole().print(table, markup=False)


def reconstruct_command(
    source: Path,
    /,
    *,
    out: Path,
    marker_size_m: float = 0.0,
    marker_dictionary: str = DEFAULT_DICTIONARY,
    marker_id: tuple[int, ...] = (),
    marker_on: Literal["auto", "floor", "wall"] = "auto",
    length: tuple[str, ...] = (),
    scale: float = 0.0,
    preset: Preset = "draft",
    steps: int | None = None,
    side_px: int | None = None,
    plain: bool = False,
    device: Device = "cpu",
    frames: int = 300,
    mapper: Literal["auto", "incremental", "global"] = "auto",
    threads: int = 0,
    license: str = "",
    work: Path | None = None,
    listen: str = "",
    json: bool = False,
) -> None:
    """Make a scene bundle from a video or photos: metric poses, Gaussians, maps.

    Finished stages are kept, and an interrupted training resumes: run the same command.

    Args:
        source: A video, a folder of photos, or a folder with a COLMAP model and images/.
        out: Scene bundle to make; must not exist.
        marker_size_m: Side of the black square of the printed markers [m]; see `readygo marker`.
        marker_dictionary: Dictionary of the markers, as OpenCV names it.
        marker_id: Ids of the markers of that size; all detected ones by default.
        marker_on: Surface on which the markers lie; auto infers it from the camera's orientation.
        length: Length between two points picked in two images, "a.jpg:u,v a.jpg:u,v b.jpg:u,v b.jpg:u,v = 2.35", both
            ends in each image [px, m]; with a marker, it checks the marker.
        scale: Metres per unit of the map, without marker or length.
        preset: draft takes minutes on two cores; standard and high take longer.
        steps: Training steps; those of the preset by default.
        side_px: Longer side of the training images [px]: larger ones are scaled down; that of the preset by default.
        plain: Train without the surface losses: faster, better images, worse depths and maps.
        device: cuda trains with gsplat's kernels on a GPU; experimental, no GPU has run it yet.
        frames: Largest number of video frames to use.
        mapper: auto is incremental up to 200 images, global beyond.
        threads: Threads of the mapper; 0 uses all cores, 1 gives the same map each time.
        license: License of the scene; recorded in everything made from it.
        work: State folder; OUT.work by default.
        listen: Let a `readygo worker reconstructor` do the job that joins at this endpoint, such as tcp/0.0.0.0:7447,
            on a machine with the same paths.
        json: Print the report as JSON.
    """
    metric = _metric(
        marker_size_m=marker_size_m,
        marker_dictionary=marker_dictionary,
        marker_ids=marker_id,
        marker_on=marker_on,
        lengths=length,
        scale=scale,
    )
    config = _config(metric, frames, mapper, threads, _gaussians(preset, steps, side_px, plain, device))
    if listen:
        check_endpoint(listen, "--listen")
    job = Job(source=source, out=out, work=work or out.with_name(f"{out.name}.work"), license=license)
    lines = Lines(STAGES)
    try:
        report = ask_worker(job, config, listen, lines) if listen else reconstruct(job, config, lines.say)
    except KeyboardInterrupt:
        # The job removes its folder if no stage in it is finished.
        kept = f"finished stages stay in {job.work}" if job.work.exists() else "no stage is finished yet"
        words = f"{kept}, run the same command again to resume."
        raise KeyboardInterrupt(words) from None
    if json:
        sys.stdout.write(json_module.dumps(report) + "\n")
        return
    _print_scene(source, job, report)
    scene_report(str(out))


def _metric(**settings: Any) -> MetricConfig:
    try:
        return MetricConfig(**settings)
    except ValueError as error:
        raise ConfigError(str(error)) from error


def _gaussians(preset: Preset, steps: int | None, side_px: int | None, plain: bool, device: Device) -> GaussiansConfig:
    """A preset, overridden by the options that were given."""
    settings = settings_of(preset)
    changes: dict[str, Any] = {"steps": steps, "side_max_px": side_px, "device": device}
    try:
        settings = replace(settings, **{name: value for name, value in changes.items() if value is not None})
    except ValueError as error:
        raise ConfigError(str(error)) from error
    return replace(settings, geometry=replace(settings.geometry, enabled=False)) if plain else settings


def _config(
    metric: MetricConfig,
    frames: int,
    mapper: Literal["auto", "incremental", "global"],
    threads: int,
    gaussians: GaussiansConfig,
) -> ReconstructorConfig:
    try:
        return ReconstructorConfig(
            frames=FramesConfig(count_max=frames),
            poses=PosesConfig(mapper=mapper, threads=threads),
            metric=metric,
            gaussians=gaussians,
        )
    except ValueError as error:
        raise ConfigError(str(error)) from error


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
        quality = f"PSNR {training['psnr_db']:.2f} dB, SSIM {training['ssim']:.3f} ({len(training['held_out'])} images)"
    table = Table(title=f"{job.out.name}, made of {source.name}", show_header=False)
    for label, text in _rows(report):
        table.add_row(label, text)
    made = f"{training['gaussians']:,} trained on {training['images']} images"
    left = f"unseen: {training['unseen']:,}, {report['removed']}"
    table.add_row("Gaussians", f"{made}; left out: {left}; kept as sky: {report['sky']:,}")
    table.add_row("held-out images", quality)
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


def marker(
    *,
    size_m: float = 0.2,
    out: Path,
    dictionary: str = DEFAULT_DICTIONARY,
    id: int = 0,
    page: Literal["A4", "A3", "A2", "letter"] = "A3",
) -> None:
    """Write a PDF with one marker at true size: print it at 100 %, measure it, and put it on the floor.

    Args:
        size_m: Side of the black square [m].
        out: PDF to write.
        dictionary: ArUco or AprilTag dictionary, as OpenCV names it.
        id: Id of the marker in the dictionary.
        page: Paper size; the marker needs a white border of one cell.
    """
    write_whole(out, marker_pdf(dictionary, id, size_m, page))
    PlainConsole(soft_wrap=True).print(f"{out}: marker {id} of {dictionary}, {size_m:g} m wide.", markup=False)
