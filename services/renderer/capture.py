"""From moments to the images that a camera records: lens, shutter, exposure, noise.

Without a sensor an image is exactly what the rasterizer draws.
"""

import dataclasses
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import tee
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.lens import Lens, make_lens
from readygo.common.images.images import Images
from readygo.common.rasterizer.interface import View, render_each
from readygo.common.robot.kinematics import DT_S
from readygo.services.renderer.drawing import Drawing
from readygo.services.renderer.sensor.faces import R_FACE_CAMERA, Faces, Remap, make_remap, plan_faces
from readygo.services.renderer.sensor.light import LightSum, exposure_gain
from readygo.services.renderer.sensor.motion import Moment
from readygo.services.renderer.sensor.shutter import Shutter, make_shutter
from readygo.services.renderer.sensor.streams import SensorStream

MomentAt = Callable[[float], Moment]
"""The moment at a simulation step, which need not be whole."""
Floats = npt.NDArray[np.float64]
Wanted = tuple[Moment, Floats, Floats | None, tuple[str, ...]]
"""A moment, the pose and, where they differ, the intrinsics that it is drawn with, and the images that are made."""
Exposure = tuple[Moment, npt.NDArray[np.int64], npt.NDArray[np.bool_]]
"""A moment, its share in each row of the image, and the rows whose middle it is."""
EPISODE_CAMERAS_KEPT = 16
"""Remaps take 3 MB each for an image of 144x256."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeCamera:
    """The camera of one episode."""

    config: CameraConfig
    """Camera with the values that the sensor drew for the episode."""
    lens: Lens
    remap: Remap | None
    shutter: Shutter
    gain: npt.NDArray[np.float64]
    stream: SensorStream
    K_px: Floats | None = None
    """Intrinsics [px] where they are not those of the pinhole camera that the rasterizer draws, shape (3, 3)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """A frame to take."""

    camera: EpisodeCamera
    moment_at: MomentAt
    """Camera pose and humans over time."""
    step: int
    """The frame's own step, at which its last row's exposure ends."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pinhole:
    """What the rasterizer has to draw for a camera."""

    faces: Faces | None
    """Faces to draw; None if the image itself is drawn."""
    K_px: npt.NDArray[np.float64]
    height_px: int
    width_px: int

    def draws_like(self, other: "Pinhole") -> bool:
        """True if the same images are drawn for both."""
        size, other_size = (self.height_px, self.width_px), (other.height_px, other.width_px)
        return size == other_size and np.array_equal(self.K_px, other.K_px)


def pinhole_of(sensor: SensorConfig, camera: CameraConfig) -> Pinhole:
    """The pinhole camera that holds what a camera shows with every lens of a sensor's ranges.

    Raises:
        ConfigError: If a lens cannot be drawn.
    """
    if camera.distortion == "none":
        return Pinhole(faces=None, K_px=camera.K_px, height_px=camera.height_px, width_px=camera.width_px)
    faces = plan_faces([make_lens(extreme) for extreme in sensor.extremes(camera)])
    return Pinhole(faces=faces, K_px=faces.K_px, height_px=faces.height_px, width_px=faces.width_px)


@dataclass(frozen=True, kw_only=True, eq=False)
class Capture:
    """Takes pictures."""

    drawing: Drawing
    """Is drawn with the pinhole camera of `pinhole`."""
    pinhole: Pinhole
    sensor: SensorConfig
    camera: CameraConfig
    sub_frames: int
    """Images that a frame is made of where the shutter takes time."""
    dt_s: float = DT_S
    """Length of a step [s]."""
    name: str = ""
    """The camera's; empty for the robot's first one."""
    _cameras: OrderedDict[SensorStream, EpisodeCamera] = field(default_factory=OrderedDict)

    def camera_of(self, stream: SensorStream, camera: CameraConfig | None = None) -> EpisodeCamera:
        """The camera of the episode that a stream belongs to.

        Args:
            stream: Of the episode.
            camera: Its robot's, where robots differ: with another mount or field of view.
        """
        stream = stream.of_camera(self.name)
        if stream not in self._cameras:
            self._cameras[stream] = self._drawn(stream, camera or self.camera)
            while len(self._cameras) > EPISODE_CAMERAS_KEPT:
                self._cameras.popitem(last=False)
        self._cameras.move_to_end(stream)
        return self._cameras[stream]

    def take(self, shots: Iterable[Shot], outputs: tuple[str, ...] = ("rgb",)) -> Iterator[Images]:
        """The images of one frame after the other; views go to the rasterizer in batches as large as it likes them.

        Colour is what the sensor makes of the light. Depth, alpha, mask and normal have no noise and no blur: each
        pixel shows the middle of its row's exposure, at its centre. Depth is along the optical axis.

        Args:
            shots: Frames; taken from the iterable only when they are drawn.
            outputs: Names out of `readygo.common.images.images.OUTPUTS`.
        """
        if self.camera.ideal and not self.sensor.varies:
            moments = ((shot.moment_at(float(shot.step)), shot.camera.K_px) for shot in shots)
            yield from self._images((moment, moment.T_world_camera, K_px, outputs) for moment, K_px in moments)
            return
        planned, ahead = tee((shot, _exposures(shot.camera.shutter, shot.moment_at, shot.step)) for shot in shots)
        drawn = self._images(
            (moment, pose, shot.camera.K_px, outputs if rows.any() else ("rgb",))
            for shot, exposures in ahead
            for moment, _, rows in exposures
            for pose in _face_poses(moment.T_world_camera, shot.camera.remap)
        )
        for shot, exposures in planned:
            yield self._developed(shot, exposures, drawn)

    def _images(self, wanted: Iterable[Wanted]) -> Iterator[Images]:
        views = ((self._view(moment, pose, K_px), outputs) for moment, pose, K_px, outputs in wanted)
        return render_each(self.drawing.rasterizer, views)

    def _view(self, moment: Moment, T_world_camera: Floats, K_px: Floats | None) -> View:
        return self.drawing.view(T_world_camera, moment.humans, moment.step, K_px)

    def _developed(self, shot: Shot, exposures: Sequence[Exposure], drawn: Iterator[Images]) -> Images:
        """One frame of the images of its exposures' faces, which come next."""
        camera = shot.camera
        light, out = LightSum(self.camera.height_px, self.camera.width_px), None
        for _, weight, rows in exposures:
            faces = [next(drawn) for _ in (camera.remap.faces if camera.remap else (0,))]
            light.add(np.stack([face.rgb for face in faces]), camera.remap, weight)
            if rows.any():
                seen = faces[0] if camera.remap is None else _looked_up(faces, camera.remap)
                out = seen if out is None else _with_rows(out, seen, rows)
        assert out is not None
        rgb = light.developed(camera.config, camera.gain, camera.stream.of_frame(shot.step))
        return dataclasses.replace(out, rgb=rgb)

    def _drawn(self, stream: SensorStream, camera: CameraConfig) -> EpisodeCamera:
        config = self.sensor.drawn(camera, stream.of_draws())
        lens = make_lens(config)
        return EpisodeCamera(
            config=config,
            lens=lens,
            remap=self._remap(lens),
            shutter=make_shutter(config, self.sub_frames, self.dt_s),
            gain=exposure_gain(config),
            stream=stream,
            K_px=None if camera.horizontal_fov_deg == self.camera.horizontal_fov_deg else camera.K_px,
        )

    def _remap(self, lens: Lens) -> Remap | None:
        if self.pinhole.faces is None:
            return None
        known = (camera.remap for camera in self._cameras.values() if camera.lens.coefficients == lens.coefficients)
        return next(known, None) or make_remap(lens, self.pinhole.faces)


def _exposures(shutter: Shutter, moment_at: MomentAt, step: int) -> list[Exposure]:
    """Moments, the share of each in each row, and the rows whose middle each is; equal neighbours become one."""
    found: list[Exposure] = []
    for index, after in enumerate(shutter.steps):
        moment, weight, rows = moment_at(step + after), shutter.weight[index], shutter.middle == index
        if found and moment.equals(found[-1][0]):
            moment, weight, rows = found[-1][0], found[-1][1] + weight, found[-1][2] | rows
            found.pop()
        found.append((moment, weight, rows))
    return found


def _face_poses(T_world_camera: npt.NDArray[np.float64], remap: Remap | None) -> list[npt.NDArray[np.float64]]:
    """Poses of the cameras that draw the faces."""
    if remap is None:
        return [T_world_camera]
    poses = []
    for face in remap.faces:
        pose = T_world_camera.copy()
        for k, axis in enumerate(R_FACE_CAMERA[face]):
            pose[:3, k] = axis[0] * T_world_camera[:3, 0] + axis[1] * T_world_camera[:3, 1]
            pose[:3, k] += axis[2] * T_world_camera[:3, 2]
        poses.append(pose)
    return poses


def _looked_up(faces: Sequence[Images], remap: Remap) -> Images:
    """Images of the faces at the centres of the distorted image's pixels; depth along the camera's optical axis."""
    values: dict[str, npt.NDArray[Any]] = {}
    for name in faces[0].arrays():
        stacked = np.stack([getattr(face, name) for face in faces])
        values[name] = stacked.reshape(-1, *stacked.shape[3:])[remap.nearest]
        if name in ("depth_m", "median_depth_m"):
            values[name] = (values[name] * remap.depth_factor).astype(np.float32)
        elif name == "normal":
            values[name] = _turned_back(values[name], remap)
    return Images(**values)


def _turned_back(normal: npt.NDArray[Any], remap: Remap) -> npt.NDArray[np.float32]:
    """Normals in the faces' frames, shape (H, W, 3), in the camera's frame."""
    R = R_FACE_CAMERA[list(remap.faces)][remap.face].astype(np.float32)
    turned = [
        R[..., 0, i] * normal[..., 0] + R[..., 1, i] * normal[..., 1] + R[..., 2, i] * normal[..., 2] for i in range(3)
    ]
    return np.stack(turned, axis=-1).astype(np.float32)


def _with_rows(images: Images, others: Images, rows: npt.NDArray[np.bool_]) -> Images:
    """Images whose given rows are those of others."""
    values = {name: array.copy() for name, array in images.arrays().items()}
    for name, value in values.items():
        value[rows] = getattr(others, name)[rows]
    return Images(**values)
