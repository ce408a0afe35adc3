"""`readygo demo --reconstruct`: films a room of the embedded flat, reconstructs it, and records episodes in it."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from readygo.apps.capture.compare import pose_errors
from readygo.apps.capture.config import CaptureConfig
from readygo.apps.capture.film import film, ground_of, plan_filming
from readygo.apps.capture.truth import read_truth
from readygo.apps.fleet.run import record
from readygo.apps.pictures.recorded import RecordedEpisodes
from readygo.apps.report.reconstruction import Reconstructed, reconstruction_page
from readygo.common.dataset import Dataset
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.common.messages import Split
from readygo.common.scenes import Scene, load_scene
from readygo.common.scenes.top_view import top_view
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.spec import make_spec
from readygo.services.reconstructor import (
    GaussiansConfig,
    Job,
    MetricConfig,
    PosesConfig,
    ReconstructorConfig,
    Say,
    check_installed,
    preset,
    reconstruct_scene,
)

ROOM_M = (-5.2, 0.6, 0.5, 4.8)
"""x0, y0, x1, y1 of the flat's living room [m]."""
MARKER_M = 0.2
EPISODES = 8
_WALK = CaptureConfig(seconds=60.0, fps=2, marker_size_m=MARKER_M)
_STEPS, _SIDE_PX = 1500, 320


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
    report = reconstruct_scene(job, config, stages)
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
    """The settings of `draft`, for small images and fewer steps; nothing moves in the demo's video."""
    return replace(preset("draft"), steps=_STEPS, side_max_px=_SIDE_PX, transients=False)


def _write_page(out: Path, made: Reconstructed) -> Path:
    dataset = Dataset(made.data)
    recorded = RecordedEpisodes(dataset, made.found.maps.robot)
    episode = out / "episode.webm"
    recorded.write_film(episode, recorded.best_encounter(list(dataset.episodes)), top_view(made.found))
    path = out / "reconstruction.html"
    write_whole(path, reconstruction_page(made, episode))
    return path
