"""`readygo demo --reconstruct`: films a room of the embedded flat, reconstructs it, and records episodes in it."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.apps.capture.compare import PoseErrors, pose_errors
from readygo.apps.capture.config import CaptureConfig
from readygo.apps.capture.film import film, ground_of, plan_filming
from readygo.apps.capture.truth import read_truth
from readygo.apps.fleet.run import record
from readygo.apps.pages.page import Column, figure, film_figure, page, png_source, table
from readygo.apps.pictures.recorded import RecordedEpisodes
from readygo.apps.run.config import RunConfig, load_run_config
from readygo.apps.run.folder import RunFolder
from readygo.apps.run.spec import make_spec
from readygo.apps.run.world import World
from readygo.common.dataset import Dataset
from readygo.common.documents import read_json
from readygo.common.drawing.files import Picture
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.common.images.encoded import read_pixels
from readygo.common.messages import Split
from readygo.common.scenes import Scene, load_scene
from readygo.common.scenes.scene import REPORT_FILE
from readygo.common.scenes.top_view import top_view
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.reconstruct import GAUSSIANS, Job, check_installed, reconstruct
from readygo.services.reconstructor.stages import Say
from readygo.services.reconstructor.training.config import GaussiansConfig, preset

ROOM_M = (-5.2, 0.6, 0.5, 4.8)
"""x0, y0, x1, y1 of the flat's living room [m]."""
MARKER_M = 0.2
EPISODES = 8
_WALK = CaptureConfig(seconds=60.0, fps=2, marker_size_m=MARKER_M)
_STEPS, _SIDE_PX = 1500, 320
_SHOWN = 4
_PICTURE_PX = 720


@dataclass(frozen=True, kw_only=True, eq=False)
class Reconstructed:
    """A room that was filmed and reconstructed, and the data that was recorded there."""

    report: dict[str, Any]
    """Report of the reconstruction, as returned by `reconstruct`."""
    errors: PoseErrors
    work: Path
    source: Scene
    found: Scene
    data: Path
    seconds: float


def demo_reconstruction(scene: Scene, out: Path, say: Callable[[str], None], stages: Say) -> Path:
    """Film a room, reconstruct it, record episodes there, and write a page.

    Args:
        scene: The embedded scene.
        out: Folder of the demo.
        say: Called with a line of text when a step begins.
        stages: Called with the progress of the reconstruction's stages.

    Returns:
        Path of the page.

    Raises:
        ReadygoError: If the reconstruction, the data or the page cannot be made.
    """
    check_installed()
    begin_s = time.monotonic()
    run = out / "run"
    run.mkdir(parents=True, exist_ok=True)
    say(f"filming a walk of {_WALK.seconds:g} s through the living room, past a marker of {MARKER_M:g} m")
    # VP8 encodes many times faster than the codec of an .mp4.
    video = run / "walk.webm"
    truth = read_truth(film(plan_filming(scene, ground_of(scene, ROOM_M, None, 1.0), _WALK), video, lambda _: None))
    say("finding where it was filmed from, and training Gaussians")
    job = Job(source=video, out=run / "room", work=run / "room.work", license=scene.license)
    metric = MetricConfig(marker_size_m=MARKER_M)
    # One thread makes the same map each time.
    config = ReconstructorConfig(poses=PosesConfig(threads=1), metric=metric, gaussians=training())
    report = reconstruct(job, config, stages)
    found = load_scene(job.out)
    if found.views is None:
        raise RunError(f"{job.out} has no cameras.")
    errors = pose_errors(truth, dict(zip(found.views.images, found.views.T_world_camera, strict=True)))
    say(f"recording {EPISODES} episodes in the reconstruction")
    data = run / "data"
    spec = make_spec(found, None, narrow(load_run_config(None, None)), seed=0, split=Split.TRAIN, static=False)
    record(spec, data, episodes=EPISODES, workers=0)
    made = Reconstructed(
        report=report,
        errors=errors,
        work=job.work,
        source=scene,
        found=found,
        data=data,
        seconds=time.monotonic() - begin_s,
    )
    return _write_page(out, made)


def narrow(settings: RunConfig) -> RunConfig:
    """The settings for a furnished room: short paths, and one human, who passes close by furniture."""
    return replace(
        settings,
        episode=replace(settings.episode, goal_distance_min_m=1.5, goal_distance_max_m=4.0, human_count_max=1),
        human_planner=replace(settings.human_planner, spacing="narrow"),
    )


def training() -> GaussiansConfig:
    """The settings of `draft`, for small images and fewer steps."""
    return replace(preset("draft"), steps=_STEPS, side_max_px=_SIDE_PX)


def _write_page(out: Path, made: Reconstructed) -> Path:
    dataset = Dataset(made.data)
    spec, _ = RunFolder(made.data).load()
    recorded = RecordedEpisodes(dataset, World(spec))
    shown = recorded.best_encounter(list(dataset.episodes))
    above = top_view(made.found)
    recorded.write_film(out / "episode.webm", shown, above)
    text = page(
        "A room that was filmed",
        "A walk with a telephone through the living room of the embedded flat, past one printed marker: cameras, "
        "scale, Gaussians and maps were made of its film alone, and a robot was driven there among walking people.",
        tiles=tiles(made),
        sections=[
            ("Filmed and reconstructed", _held_out(made)),
            ("From above", _from_above(made)),
            ("An episode in the reconstruction", film_figure(out / "episode.webm", "As it is recorded for training.")),
            ("In numbers", _numbers(made, dataset)),
        ],
        facts={"scene": made.found.content_hash},
    )
    path = out / "reconstruction.html"
    write_whole(path, text)
    return path


def tiles(made: Reconstructed) -> list[tuple[str, str]]:
    """The key figures at the top of the page: label and text."""
    training, errors = made.report["training"], made.errors
    return [
        (f"{errors.scale_percent:+.2f} %", "error of lengths, against the truth"),
        (f"{100 * errors.camera_rmse_m:.1f} cm", "error of cameras (rmse)"),
        (f"{training['psnr_db']:.1f} dB", "PSNR of images it has not seen"),
        (f"{_reachable_m2(made.found):.1f} m2", "for the robot to move in"),
        (f"{made.seconds / 60:.0f} min", "in all"),
    ]


def _reachable_m2(scene: Scene) -> float:
    return float(read_json(scene.path / REPORT_FILE)["robot"]["reachable_m2"])


def _held_out(made: Reconstructed) -> str:
    folder = made.work / GAUSSIANS / "previews" / "held_out"
    rows = sorted(made.report["training"]["held_out"], key=lambda row: str(row["image"]))
    chosen = rows[:: max(1, len(rows) // _SHOWN)][:_SHOWN]
    return "".join(
        figure(
            png_source(photo_and_image(folder / f"{Path(row['image']).stem}.png")),
            f"Left the film, right the reconstruction from the same place, of which it had no image: "
            f"{row['psnr_db']:.1f} dB.",
            alt="film and reconstruction",
        )
        for row in chosen
    )


def photo_and_image(path: Path) -> Picture:
    """The first two of a held-out preview's three pictures, enlarged.

    Raises:
        RunError: If the preview cannot be read.
    """
    bgr = read_pixels(path, cv2.IMREAD_COLOR)
    if bgr is None:
        raise RunError(f"{path} cannot be read.")
    both = cv2.cvtColor(bgr[:, : bgr.shape[1] // 3 * 2], cv2.COLOR_BGR2RGB)
    factor = max(1, _PICTURE_PX // both.shape[1] + 1)
    return np.asarray(cv2.resize(both, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def _from_above(made: Reconstructed) -> str:
    captions = ((made.source, "The flat."), (made.found, "What the film's reconstruction has of it, in its own frame."))
    figures = [figure(png_source(top_view(scene).rgb), words, alt=words) for scene, words in captions]
    return f'<div class="pair">{"".join(figures)}</div>'


def _numbers(made: Reconstructed, dataset: Dataset) -> str:
    report, errors = made.report, made.errors
    interval = report["scale"]["interval_percent"]
    rows = [
        ["images with a pose", f"{report['verdict']['registered']} of {report['verdict']['images']}"],
        ["error of lengths", f"{errors.scale_percent:+.2f} %; its interval says +-{interval:.2f} % (95 %)"],
        ["error of cameras", f"{100 * errors.camera_rmse_m:.1f} cm rmse, {100 * errors.camera_max_m:.1f} cm at most"],
        ["error of up", f"{errors.up_deg:.2f} deg"],
        ["Gaussians", f"{report['training']['gaussians']:,}"],
        ["held-out images", f"{report['training']['psnr_db']:.2f} dB, SSIM {report['training']['ssim']:.3f}"],
        ["recorded", f"{len(dataset.episodes)} episodes, {sum(e.sample_count for e in dataset.episodes):,} samples"],
        *[[f"time of {escape(stage)}", f"{seconds:.0f} s"] for stage, seconds in report["seconds"].items()],
    ]
    return table((Column("What"), Column("Value", "wide")), rows)
