"""Simulated capture: the images that a hand-held phone records of a scene with a marker, and the ground truth."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.apps.capture.config import CaptureConfig, phone_camera
from readygo.apps.capture.ground import WalkableGround, walking_ground
from readygo.apps.capture.marker import FloorMarker, MarkedRasterizer, lay_down
from readygo.apps.capture.panorama import face_poses, join_faces
from readygo.apps.capture.people import people_mask, plan_people
from readygo.apps.capture.truth import EQUIRECTANGULAR, image_name, truth_path, write_truth
from readygo.apps.capture.walk import CameraWalk, Sway, plan_walk
from readygo.apps.pictures.film import CODECS, write_film
from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.avatars import Avatar, load_avatars
from readygo.common.camera import CameraConfig
from readygo.common.errors import ConfigError, SceneError
from readygo.common.files import unfinished_folder, write_whole
from readygo.common.images.images import Images
from readygo.common.messages import HumanMotion
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene
from readygo.services.reconstructor import PrintedSheet, draw_marker_sheet, write_jpeg
from readygo.services.renderer import Renderer, RendererConfig, Shot

_PAGES = ("A3", "A2")


@dataclass(frozen=True, kw_only=True, eq=False)
class Filming:
    """A planned capture: walk, marker and exposures."""

    scene: Scene
    config: CaptureConfig
    camera: CameraConfig
    walk: CameraWalk
    marker: FloorMarker | None
    exposures_ev: Float64Array
    """Exposure of each frame [stops], shape (N,)."""
    people: tuple[HumanMotion, ...] = ()
    """People who walk through it, at 20 Hz from the beginning on."""
    avatars: Mapping[str, Avatar] = field(default_factory=dict)
    """What they look like, by name."""

    @property
    def times_s(self) -> Float64Array:
        """Time of each frame, the end of its last row's exposure [s], shape (N,)."""
        return (np.arange(self.config.frames) + 0.5) / self.config.fps

    @property
    def notes(self) -> list[str]:
        """Hints for the user about the planned capture."""
        walk = self.walk
        if walk.way_m >= walk.loop_m:
            return []
        return [
            f"the walk of {walk.way_m:.1f} m does not close its loop of {walk.loop_m:.1f} m; "
            f"--seconds {math.ceil(walk.loop_m * 2.2):d} does, or a smaller --radius."
        ]


def plan_filming(scene: Scene, ground: WalkableGround, config: CaptureConfig) -> Filming:
    """Plan walk, marker and exposure of a capture.

    Raises:
        ConfigError: If the marker fits no sheet, or the lens cannot be drawn.
        SceneError: If the ground is too narrow, or has no room for the people.
    """
    sheet = _sheet(config) if config.marker_size_m else None
    rng = np.random.Generator(np.random.Philox(config.seed))
    walk = plan_walk(scene, ground, config.seconds, rng)
    yaw_rad = float(rng.uniform(0.0, math.tau))
    marker = None
    if sheet is not None:
        marker = lay_down(sheet, scene.cloud, scene.maps.floor, ground.centres_m, walk.marker_xy_m, yaw_rad)
    times_s = (np.arange(config.frames) + 0.5) / config.fps
    drift_ev = Sway(rng).slow(times_s, config.exposure_ev, 13.0)
    avatars = load_avatars() if config.people else {}
    camera_xy_m = walk.knots[:, :2]
    people = plan_people(ground, scene.maps.floor, camera_xy_m, avatars, config.people, rng)
    return Filming(
        scene=scene,
        config=config,
        camera=phone_camera(config),
        walk=walk,
        marker=marker,
        exposures_ev=np.zeros_like(drift_ev) if config.photos else drift_ev,
        people=people,
        avatars=avatars,
    )


def _sheet(config: CaptureConfig) -> PrintedSheet:
    """The sheet of `readygo marker`, on the first page that holds it."""
    for page in _PAGES[:-1]:
        with suppress(ConfigError):
            return draw_marker_sheet(config.marker_dictionary, config.marker_id, config.marker_size_m, page)
    return draw_marker_sheet(config.marker_dictionary, config.marker_id, config.marker_size_m, _PAGES[-1])


def pictures(filming: Filming) -> Iterator[UInt8Array]:
    """Frames of the capture, sRGB, shape (H, W, 3) each; deterministic for a plan."""
    rgbs = (images.rgb for images in frames(filming))
    return join_faces(rgbs, filming.config.width_px) if filming.config.equirectangular else rgbs


def frames(filming: Filming) -> Iterator[Images]:
    """Frames of the capture, with the mask of the people if there are any; of 360 degrees, the faces of each."""
    robot, config = RobotConfig(camera=filming.camera), filming.config
    outputs = ("rgb", "median_depth", "mask") if filming.people else ("rgb", "median_depth")
    settings = RendererConfig(human_light=False, outputs=outputs, labels=False, sub_frames=config.sub_frames or 2)
    renderer = Renderer(filming.scene, filming.avatars, robot, settings)
    if filming.marker is not None:
        renderer.rasterizers[""] = MarkedRasterizer(renderer.rasterizers[""], renderer.pinholes[""], filming.marker)
    shots = [
        Shot(
            step=_step(filming, number, robot.clock.dt_s),
            pose_at=pose_at,
            humans=filming.people,
            episode=f"capture {config.seed}{face}",
            exposure_ev=exposure_ev,
        )
        for number, exposure_ev in enumerate(filming.exposures_ev.tolist())
        for face, pose_at in _lookouts(filming, number, robot.clock.dt_s)
    ]
    for views in renderer.render(shots, ("rgb", "mask") if filming.people else ("rgb",)):
        yield views[""]


def _step(filming: Filming, number: int, dt_s: float) -> int:
    """Step of a frame: its number, or with people the nearest step of their motion."""
    return round(float(filming.times_s[number]) / dt_s) if filming.people else number


def _lookouts(filming: Filming, number: int, dt_s: float) -> list[tuple[str, Callable[[object, float], Float64Array]]]:
    """Poses of the camera around a frame; of 360 degrees, those of each face with its name."""
    if not filming.config.equirectangular:
        return [("", _poses(filming, number, dt_s))]
    faces = face_poses(filming.walk.pose_at(float(filming.times_s[number])))
    return [(f" face {face}", partial(_stand, T)) for face, T in enumerate(faces)]


def _stand(T_world_camera: Float64Array, _camera: object, _step: float) -> Float64Array:
    """The pose of a camera that rests."""
    return T_world_camera


def _poses(filming: Filming, number: int, dt_s: float) -> Callable[[object, float], Float64Array]:
    """Poses of the camera around a frame; the shutter counts in steps of the simulation, which last `dt_s` [s]."""
    time_s, at = float(filming.times_s[number]), _step(filming, number, dt_s)
    return lambda _, step: filming.walk.pose_at(time_s + (step - at) * dt_s)


def film(filming: Filming, out: Path, heard: Callable[[int], None]) -> Path:
    """Write the video, or the folder of photos, and the ground truth beside it.

    Args:
        filming: Planned capture.
        out: The video, .mp4 or .webm, or the folder.
        heard: Called with the number of finished frames.

    Returns:
        Path of the truth file.

    Raises:
        ReadygoError: If something cannot be written.
    """
    images: list[int] | list[str] = list(range(filming.config.frames))
    if filming.config.photos:
        images = [f"{number:04d}.jpg" for number in range(filming.config.frames)]
    if filming.people:
        with unfinished_folder(masks_path(out), raises=SceneError) as folder:
            names = [f"{image_name(image)}.png" for image in images]
            _write(filming, out, images, _keep_masks(frames(filming), folder, names), heard)
    else:
        _write(filming, out, images, pictures(filming), heard)
    path = truth_path(out)
    write_truth(path, _truth(filming, images))
    return path


def _write(
    filming: Filming, out: Path, images: Sequence[int | str], rgbs: Iterator[UInt8Array], heard: Callable[[int], None]
) -> None:
    """Write the frames, as photos or as a video."""
    if not filming.config.photos:
        write_film(out, _count_frames(rgbs, heard), fps=filming.config.fps)
        return
    with unfinished_folder(out, raises=SceneError) as folder:
        for number, (name, rgb) in enumerate(zip(images, rgbs, strict=True), start=1):
            write_jpeg(folder / str(name), np.ascontiguousarray(rgb[:, :, ::-1]))
            heard(number)


def masks_path(out: Path) -> Path:
    """Folder of the masks of people, beside the video or the folder of photos."""
    return out.with_name(f"{out.stem}.masks")


def _keep_masks(taken: Iterator[Images], folder: Path, names: Sequence[str]) -> Iterator[UInt8Array]:
    """The colours of frames, whose masks are written on the way."""
    for name, images in zip(names, taken, strict=True):
        assert images.mask is not None
        data = cv2.imencode(".png", people_mask(images.mask))[1].tobytes()
        write_whole(folder / name, data, raises=SceneError)
        yield images.rgb


def check_out(out: Path, config: CaptureConfig) -> None:
    """Check the output's name before the work begins.

    Raises:
        ReadygoError: If no output can be written under this name.
    """
    # Paths without a name, such as ".", are refused below.
    if config.people and out.name and masks_path(out).exists():
        raise SceneError(f"{masks_path(out)} exists already; remove it, or choose another name.")
    if config.photos and (out.exists() or out.suffix):
        raise SceneError(f"{out} must be the name of a new folder for --photos.")
    if not config.photos and out.suffix.lower() not in CODECS:
        raise SceneError(f"{out} must end in {' or '.join(CODECS)} to be a film; --photos writes a folder of JPEGs.")


def _count_frames(frames: Iterator[UInt8Array], heard: Callable[[int], None]) -> Iterator[UInt8Array]:
    for number, rgb in enumerate(frames, start=1):
        yield rgb
        heard(number)


def _truth(filming: Filming, images: Sequence[int | str]) -> dict[str, Any]:
    camera, config, marker = filming.camera, filming.config, filming.marker
    middle_s = 0.5 * (camera.exposure_s + camera.readout_s)
    return {
        "scene": {"name": filming.scene.name, "path": str(filming.scene.path), "hash": filming.scene.content_hash},
        "seed": config.seed,
        "fps": config.fps,
        "seconds": config.seconds,
        "width_px": config.width_px,
        "height_px": config.height_px,
        "camera": {"model": EQUIRECTANGULAR} if config.equirectangular else _lens(camera),
        "metres_per_unit": 1.0,
        "people": [human.avatar for human in filming.people],
        "frames": [
            {
                "image": image,
                "time_s": round(time_s - middle_s, 6),
                "exposure_ev": round(exposure_ev, 4),
                "T_world_camera": filming.walk.pose_at(time_s - middle_s).tolist(),
            }
            for image, time_s, exposure_ev in zip(
                images, filming.times_s.tolist(), filming.exposures_ev.tolist(), strict=True
            )
        ],
        "marker": None
        if marker is None
        else {
            "id": config.marker_id,
            "dictionary": config.marker_dictionary,
            "size_m": config.marker_size_m,
            "corners_m": marker.corners_m.tolist(),
        },
    }


def _lens(camera: CameraConfig) -> dict[str, Any]:
    return {
        "model": "OPENCV",
        **{name.removesuffix("_px"): getattr(camera, name) for name in ("fx_px", "fy_px", "cx_px", "cy_px")},
        **{name: getattr(camera, name) for name in ("k1", "k2", "p1", "p2")},
    }


def ground_of(
    scene: Scene, crop: tuple[float, float, float, float] | None, start: tuple[float, float] | None, radius_m: float
) -> WalkableGround:
    """The ground to film, from the command's options.

    Args:
        scene: Scene bundle.
        crop: x0 y0 x1 y1 of the filmed area [m], instead of start and radius.
        start: Centre of the filmed area [m].
        radius_m: Radius of the filmed area [m].

    Raises:
        ConfigError: If the options contradict each other, or a number is invalid.
        SceneError: If the area has no walkable ground.
    """
    if crop is not None and start is not None:
        raise ConfigError("Give either --crop, or --start and --radius.")
    if crop is not None and not (crop[0] < crop[2] and crop[1] < crop[3]):
        raise ConfigError(f"--crop is X0 Y0 X1 Y1 with X0 < X1 and Y0 < Y1, got {' '.join(map(str, crop))}.")
    if not radius_m > 0.0:
        raise ConfigError(f"--radius must be positive, got {radius_m:g}.")
    return walking_ground(scene, crop=crop, start=start, radius_m=radius_m)
