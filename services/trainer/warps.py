"""Frames as a robot's cameras would have them, had it been turned, shifted or mirrored."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import cached_property

import cv2
import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, Int64Array, UInt8Array
from readygo.common.camera import CameraConfig
from readygo.common.camera.depth import scale_depth_bytes
from readygo.common.camera.lens import make_lens
from readygo.common.images.names import cameras_of, kinds_of
from readygo.common.policy.sight import camera_on, channels_of
from readygo.common.robot import RobotConfig
from readygo.services.trainer.views import BatchViews

COLOURS = 3
"""Channels that are colours; those behind them are depths."""
_AHEAD_MIN = 1e-6
"""Rays that go less far ahead are beside the camera."""


def in_mirror(camera: CameraConfig) -> CameraConfig:
    """The camera of a robot in a mirror, on its other side."""
    return dataclasses.replace(
        camera,
        cx_px=None if camera.cx_px is None else camera.width_px - camera.cx_px,
        p2=-camera.p2,
        mount_y_m=-camera.mount_y_m,
        mount_yaw_deg=camera.mount_yaw_deg if abs(camera.mount_yaw_deg) == 180.0 else -camera.mount_yaw_deg,
    )


def mirror_twins(robot: RobotConfig, cameras: Sequence[str]) -> dict[str, str] | None:
    """Which camera shows in a mirror what each one shows: itself, or that of the other side; None if there is none.

    Args:
        robot: Whose cameras they are.
        cameras: Names of those that are looked through; the first one is called "".
    """
    twins = {}
    for camera in cameras:
        wanted = in_mirror(camera_on(robot, camera))
        found = [other for other in (camera, *cameras) if camera_on(robot, other) == wanted]
        if not found:
            return None
        twins[camera] = found[0]
    return twins


class RobotWarp:
    """Shows the images of all cameras as `FrameWarp` shows those of one."""

    def __init__(self, robot: RobotConfig, images: Sequence[str], pooling: int = 1) -> None:
        """Prepare the warps of all cameras, see `FrameWarp`.

        Args:
            robot: Whose cameras took the images.
            images: Names of those that a frame has side by side.
            pooling: See `FrameWarp`.
        """
        cameras, first = cameras_of(images), 0
        self._twins = mirror_twins(robot, cameras) or {}
        self._warps = {camera: FrameWarp(camera_on(robot, camera), pooling) for camera in cameras}
        self._parts: dict[str, slice] = {}
        for camera in cameras:
            count = channels_of(kinds_of(camera, images))
            self._parts[camera] = slice(first, first + count)
            first += count

    def show(self, frames: Sequence[UInt8Array], view: BatchViews, group: int, out: Sequence[UInt8Array]) -> None:
        """See `FrameWarp.show`; a mirrored camera shows what its twin on the other side did."""
        if len(self._parts) == 1:
            self._warps[""].show(frames, view, group, out)
            return
        for camera, part in self._parts.items():
            source = self._twins.get(camera, camera) if view.mirrored[group] else camera
            seen = [np.ascontiguousarray(frame[..., self._parts[source]]) for frame in frames]
            shown = [np.empty_like(frame) for frame in seen]
            self._warps[source].show(seen, view, group, shown)
            for frame, image in zip(out, shown, strict=True):
                frame[..., part] = image


class FrameWarp:
    """Shows frames as a robot's camera would have, had the robot been turned on the spot; shifted and mirrored.

    A rotation moves pixels the same way at every depth, so that the images are exact but for what was out of view: the
    edge is repeated there. Depths are those along the turned optical axis. A camera that is not above the robot's
    centre also moves a little, which is left out. What a sensor varies of a lens between episodes is left out as well.
    """

    def __init__(self, camera: CameraConfig, pooling: int = 1) -> None:
        self._camera = camera
        self._lens = make_lens(camera)
        self._R_robot_camera = camera.T_world_camera(0.0, 0.0, 0.0, 0.0)[:3, :3]
        self._size = camera.width_px // pooling, camera.height_px // pooling
        self._pooling = pooling

    @cached_property
    def _rays(self) -> Float64Array:
        """What each pixel sees through the lens, shape (H W, 3)."""
        columns, rows = np.meshgrid(np.arange(self._size[0]) + 0.5, np.arange(self._size[1]) + 0.5)
        xy = self._lens.rays(self._pooling * np.stack([columns.ravel(), rows.ravel()], axis=1))
        return np.concatenate([xy, np.ones((len(xy), 1))], axis=1)

    def show(self, frames: Sequence[UInt8Array], view: BatchViews, group: int, out: Sequence[UInt8Array]) -> None:
        """Frames of one episode as a view has them, but for its light.

        Args:
            frames: Frames, colours before depths, each shape (H, W, C).
            view: How they are shown.
            group: Row of the episode in the view.
            out: As many, each shape (H, W, C).
        """
        yaw_rad, shift_px, mirrored = view.yaws_rad[group], view.shifts_px[group], bool(view.mirrored[group])
        if yaw_rad == 0:
            for frame, shown in zip(frames, out, strict=True):
                _move(frame, shift_px, mirrored, out=shown)
        elif self._lens.distortion == "none":
            H = self._homography(yaw_rad) @ _moved_from(shift_px, mirrored, self._size)
            for frame, shown in zip(frames, out, strict=True):
                self._warp(frame, shown, H)
        else:
            columns, rows, ahead = self._turned_maps(yaw_rad)
            for frame, shown in zip(frames, out, strict=True):
                turned = _remap_pixels(frame, (columns, rows))
                self._turn_depths(turned, ahead)
                _move(turned, shift_px, mirrored, out=shown)

    def _warp(self, frame: UInt8Array, shown: UInt8Array, H: Float64Array) -> None:
        for part, how in _parts(frame.shape[2]):
            # OpenCV writes into whole arrays alone.
            whole = part == slice(0, frame.shape[2])
            source = frame if whole else np.ascontiguousarray(frame[..., part])
            target = shown if whole else np.empty_like(source)
            flags = how | cv2.WARP_INVERSE_MAP
            cv2.warpPerspective(source, H, self._size, dst=target, flags=flags, borderMode=cv2.BORDER_REPLICATE)
            if not whole:
                shown[..., part] = target
        if frame.shape[2] > COLOURS:
            rows, columns = np.indices(shown.shape[:2])
            self._turn_depths(shown, H[2, 0] * columns + H[2, 1] * rows + H[2, 2])

    def _turn_depths(self, shown: UInt8Array, ahead: Float64Array) -> None:
        """Make depths along the old optical axis those along the turned one.

        Args:
            shown: A turned frame, changed in place.
            ahead: Parts along the old axis of rays whose part along the new axis is 1, shape (H, W).
        """
        factor = 1.0 / np.maximum(ahead, _AHEAD_MIN)
        for channel in range(COLOURS, shown.shape[2]):
            shown[..., channel] = scale_depth_bytes(shown[..., channel], factor, self._camera)

    def _rotation(self, yaw_rad: float) -> Float64Array:
        """From the turned camera's axes to those before, shape (3, 3)."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        R_before_after = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        R: Float64Array = self._R_robot_camera.T @ R_before_after @ self._R_robot_camera
        return R

    def _homography(self, yaw_rad: float) -> Float64Array:
        """Without a lens a rotation is a homography: from turned pixels to those before, shape (3, 3)."""
        # OpenCV's warp counts pixel centres from 0.
        K = np.diag([1 / self._pooling, 1 / self._pooling, 1.0]) @ self._lens.K_px
        K = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]]) @ K
        return np.asarray(K @ self._rotation(yaw_rad) @ np.linalg.inv(K), np.float64)

    def _turned_maps(self, yaw_rad: float) -> tuple[Float32Array, Float32Array, Float64Array]:
        """Through the lens: the pixel that saw every pixel's turned ray before, and the ray's part along that axis."""
        x, y, ahead = (self._rays @ self._rotation(yaw_rad).T).T
        xy = np.stack([x, y], axis=1) / np.maximum(ahead, _AHEAD_MIN)[:, None]
        # Beyond what the lens can show its polynomial would turn back into the image.
        xy *= np.minimum(1.0, self._lens.radius_max / np.maximum(np.hypot(xy[:, 0], xy[:, 1]), 1e-12))[:, None]
        pixels = self._lens.pixels(xy) / self._pooling - 0.5
        columns, rows = pixels.astype(np.float32).T.reshape(2, self._size[1], self._size[0])
        return columns, rows, ahead.reshape(columns.shape)


def show_frames(frames: UInt8Array, groups: Int64Array, view: BatchViews, warps: Mapping[int, RobotWarp]) -> UInt8Array:
    """Frames as a view has them, but for its light; the frames themselves where nothing changes.

    Args:
        frames: Frames, colours before depths, shape (F, H, W, C).
        groups: Row of each frame's episode in the view, shape (F,).
        view: How they are shown.
        warps: Of each episode's robot, by its row in the view.
    """
    if not (view.yaws_rad.any() or view.shifts_px.any() or view.mirrored.any()):
        return frames
    shown = np.empty_like(frames)
    for group in np.unique(groups).tolist():
        rows = np.flatnonzero(groups == group).tolist()
        warps[group].show([frames[row] for row in rows], view, group, [shown[row] for row in rows])
    return shown


def _parts(channels: int) -> list[tuple[slice, int]]:
    """Colours, then depths, and how what lies between pixels is found: between two depths there is none."""
    if channels == COLOURS:
        return [(slice(0, COLOURS), cv2.INTER_LINEAR)]
    return [(slice(0, COLOURS), cv2.INTER_LINEAR), (slice(COLOURS, channels), cv2.INTER_NEAREST)]


def _remap_pixels(frame: UInt8Array, maps: tuple[Float32Array, Float32Array]) -> UInt8Array:
    """A frame whose pixels come from elsewhere in it."""
    turned = [
        cv2.remap(np.ascontiguousarray(frame[..., part]), *maps, how, borderMode=cv2.BORDER_REPLICATE)
        for part, how in _parts(frame.shape[2])
    ]
    return np.concatenate([np.asarray(one, np.uint8).reshape(*one.shape[:2], -1) for one in turned], axis=2)


def _moved_from(shift_px: Int64Array, mirrored: bool, size: tuple[int, int]) -> Float64Array:
    """From shifted and mirrored pixels to those before, shape (3, 3)."""
    mirror = np.array([[-1.0, 0.0, size[0] - 1], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) if mirrored else np.eye(3)
    return np.asarray(np.array([[1.0, 0.0, -shift_px[1]], [0.0, 1.0, -shift_px[0]], [0.0, 0.0, 1.0]]) @ mirror)


def _move(frame: UInt8Array, shift_px: Int64Array, mirrored: bool, *, out: UInt8Array) -> None:
    """Shift a frame down and right, its edge repeated, and mirror it then."""
    target = out[:, ::-1] if mirrored else out
    (down, right), (height, width) = shift_px.tolist(), frame.shape[:2]
    rows, columns = slice(max(down, 0), height + min(down, 0)), slice(max(right, 0), width + min(right, 0))
    target[rows, columns] = frame[max(-down, 0) : height - max(down, 0), max(-right, 0) : width - max(right, 0)]
    target[rows, : columns.start] = target[rows, columns.start : columns.start + 1]
    target[rows, columns.stop :] = target[rows, columns.stop - 1 : columns.stop]
    target[: rows.start] = target[rows.start]
    target[rows.stop :] = target[rows.stop - 1]
