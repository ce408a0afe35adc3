"""`readygo scene capture`: a video of a scene as somebody would film it, with the truth beside it."""

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
    """Film a scene as somebody with a telephone would, with a printed marker on its floor; poses are known.

    NAME.truth.json beside the video has the pose of every frame, the lens and the marker's corners, so that what is
    reconstructed of the video can be compared with what was filmed.

    Args:
        scene: Scene bundle, or "embedded".
        out: Video to write, .mp4 or .webm; with --photos a new folder.
        walk: A video of a hand-held walk.
        photos: Sharp JPEGs taken along the same walk, with one exposure.
        marker_size_m: Side of the printed marker's black square [m], as of `readygo marker`; 0 lays down none.
        marker_dictionary: Dictionary of the marker, as OpenCV names it.
        marker_id: Which marker of the dictionary.
        start: Middle of the part that is filmed [m]; the roomiest place by default.
        radius: How far that part reaches [m].
        crop: x0 y0 x1 y1 of the part that is filmed [m], in place of start and radius.
        seconds: How long the walk takes.
        fps: Frames a second.
        size: Width and height of the images [px]; taller than wide is a telephone held upright.
        sub_frames: Images that each frame is made of, for motion blur and rolling shutter; 0: none of either.
        seed: Other seeds walk otherwise.
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
