"""`readygo scene capture`: a simulated hand-held video of a scene, with its ground truth."""

from dataclasses import dataclass, field
from pathlib import Path

from rich.progress import Progress
from tyro.conf import Positional

from readygo.apps.capture.config import CaptureConfig
from readygo.apps.capture.film import check_out, film, ground_of, masks_path, plan_filming
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError
from readygo.runs.scene_argument import open_scene
from readygo.services.reconstructor import DEFAULT_DICTIONARY


@dataclass(frozen=True, kw_only=True)
class CaptureDetailOptions:
    """Marker, area and motion blur."""

    marker_dictionary: str = DEFAULT_DICTIONARY
    """Dictionary of the marker, as OpenCV names it."""
    marker_id: int = 0
    """Id of the marker in the dictionary."""
    crop: tuple[float, float, float, float] | None = None
    """x0 y0 x1 y1 of the recorded area [m], instead of start and radius."""
    sub_frames: int = 0
    """Images averaged into each frame, for motion blur and rolling shutter; 0: neither."""
    exposure_ev: float = 0.25
    """Amplitude of the drift of a video's automatic exposure [stops]."""
    equirectangular: bool = False
    """Images of 360 degrees, twice as wide as high: --size 1280 640."""


@dataclass(frozen=True, kw_only=True)
class SceneCaptureOptions:
    """Record a simulated hand-held video or photos of a scene, with ground-truth camera poses.

    A printed marker lies on the floor of the scene. NAME.truth.json beside the video holds the pose of every frame, the
    intrinsics and the marker's corners, so that a reconstruction of the video can be compared with the scene.
    """

    scene: Positional[str]
    """Scene bundle, or "embedded"."""
    out: Path
    """Video to write, .mp4 or .webm; with --photos a new folder."""
    walk: bool = False
    """Write a video of a hand-held walk."""
    photos: bool = False
    """Write sharp JPEGs with one exposure, taken along the same walk."""
    marker_size_m: float = 0.2
    """Side of the printed marker's black square [m], as of `readygo marker`; 0: no marker."""
    start: tuple[float, float] | None = None
    """Centre of the recorded area [m]; the most open place by default."""
    radius: float = 3.0
    """Radius of the recorded area [m]."""
    seconds: float = 30.0
    """Duration of the walk [s]."""
    fps: int = 3
    """Frames per second."""
    size: tuple[int, int] = (640, 480)
    """Width and height of the images [px]; taller than wide: portrait format."""
    people: int = 0
    """People who walk through it, whose masks are written to NAME.masks, for `readygo reconstruct --masks`."""
    seed: int = 0
    """Seed of the walk."""
    details: CaptureDetailOptions = field(default_factory=CaptureDetailOptions)


def scene_capture(options: SceneCaptureOptions) -> None:
    """Record a simulated hand-held video or photos of a scene, with ground-truth camera poses."""
    if options.walk == options.photos:
        raise ConfigError("Give either --walk for a video or --photos for sharp pictures.")
    config = CaptureConfig(
        seconds=options.seconds,
        fps=options.fps,
        width_px=options.size[0],
        height_px=options.size[1],
        marker_size_m=options.marker_size_m,
        marker_dictionary=options.details.marker_dictionary,
        marker_id=options.details.marker_id,
        sub_frames=options.details.sub_frames,
        photos=options.photos,
        exposure_ev=options.details.exposure_ev,
        equirectangular=options.details.equirectangular,
        people=options.people,
        seed=options.seed,
    )
    check_out(options.out, config)
    bundle = open_scene(options.scene)
    filming = plan_filming(bundle, ground_of(bundle, options.details.crop, options.start, options.radius), config)
    notes = PlainConsole(stderr=True, soft_wrap=True)
    with Progress(console=notes, transient=True) as progress:
        task = progress.add_task("filming", total=config.frames)
        truth = film(filming, options.out, lambda done: progress.update(task, completed=done))
    for note in filming.notes:
        notes.print(f"Note: {note}", markup=False)
    walked = filming.walk
    console = PlainConsole(soft_wrap=True)
    laps = walked.way_m / walked.loop_m
    console.print(
        f"{options.out}: {config.frames} pictures of {options.size[0]}x{options.size[1]} px, "
        f"{walked.way_m:.1f} m in {options.seconds:g} s, "
        f"{laps:.1f} times around.",
        markup=False,
    )
    console.print(f"Truth: {truth}", markup=False)
    if options.people:
        console.print(f"Masks: {masks_path(options.out)}", markup=False)
