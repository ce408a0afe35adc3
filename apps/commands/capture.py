"""`readygo scene capture`: a simulated hand-held video of a scene, with its ground truth."""

from pathlib import Path

from rich.progress import Progress

from readygo.apps.capture.config import CaptureConfig
from readygo.apps.capture.film import check_out, film, ground_of, plan_filming
from readygo.apps.run.scene_argument import open_scene
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError
from readygo.services.reconstructor.metric.markers import DEFAULT_DICTIONARY


def scene_capture(
    scene: str,
    /,
    *,
    out: Path,
    walk: bool = False,
    photos: bool = False,
    marker_size_m: float = 0.2,
    marker_dictionary: str = DEFAULT_DICTIONARY,
    marker_id: int = 0,
    start: tuple[float, float] | None = None,
    radius: float = 3.0,
    crop: tuple[float, float, float, float] | None = None,
    seconds: float = 30.0,
    fps: int = 3,
    size: tuple[int, int] = (640, 480),
    sub_frames: int = 0,
    seed: int = 0,
) -> None:
    """Record a simulated hand-held video or photos of a scene, with ground-truth camera poses.

    A printed marker lies on the floor of the scene. NAME.truth.json beside the video holds the pose of every frame, the
    intrinsics and the marker's corners, so that a reconstruction of the video can be compared with the scene.

    Args:
        scene: Scene bundle, or "embedded".
        out: Video to write, .mp4 or .webm; with --photos a new folder.
        walk: Write a video of a hand-held walk.
        photos: Write sharp JPEGs with one exposure, taken along the same walk.
        marker_size_m: Side of the printed marker's black square [m], as of `readygo marker`; 0: no marker.
        marker_dictionary: Dictionary of the marker, as OpenCV names it.
        marker_id: Id of the marker in the dictionary.
        start: Centre of the recorded area [m]; the most open place by default.
        radius: Radius of the recorded area [m].
        crop: x0 y0 x1 y1 of the recorded area [m], instead of start and radius.
        seconds: Duration of the walk [s].
        fps: Frames per second.
        size: Width and height of the images [px]; taller than wide: portrait format.
        sub_frames: Images averaged into each frame, for motion blur and rolling shutter; 0: neither.
        seed: Seed of the walk.
    """
    if walk == photos:
        raise ConfigError("Give either --walk for a video or --photos for sharp pictures.")
    config = CaptureConfig(
        seconds=seconds,
        fps=fps,
        width_px=size[0],
        height_px=size[1],
        marker_size_m=marker_size_m,
        marker_dictionary=marker_dictionary,
        marker_id=marker_id,
        sub_frames=sub_frames,
        photos=photos,
        seed=seed,
    )
    check_out(out, config)
    bundle = open_scene(scene)
    filming = plan_filming(bundle, ground_of(bundle, crop, start, radius), config)
    notes = PlainConsole(stderr=True, soft_wrap=True)
    with Progress(console=notes, transient=True) as progress:
        task = progress.add_task("filming", total=config.frames)
        truth = film(filming, out, lambda done: progress.update(task, completed=done))
    for note in filming.notes:
        notes.print(f"Note: {note}", markup=False)
    walked = filming.walk
    console = PlainConsole(soft_wrap=True)
    laps = walked.way_m / walked.loop_m
    console.print(
        f"{out}: {config.frames} pictures of {size[0]}x{size[1]} px, {walked.way_m:.1f} m in {seconds:g} s, "
        f"{laps:.1f} times around.",
        markup=False,
    )
    console.print(f"Truth: {truth}", markup=False)
