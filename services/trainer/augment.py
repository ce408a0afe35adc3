"""Random changes to training samples, alike for all samples of one episode in a batch."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.common.frames import goals_in_robot_frames
from readygo.common.images.names import RGB, cameras_of, kind_of, kinds_of
from readygo.common.policy.sight import camera_on, channels_of
from readygo.common.robot import RobotConfig
from readygo.services.trainer.config import SamplingConfig
from readygo.services.trainer.samples import Indices, SampleTable

NEAR_M = 1.0
"""Goals are reached at this distance [m]."""

COLOURS = 3
"""Channels that are colours; those behind them are depths."""
Array = npt.NDArray[np.float32]
Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """How each of G episodes is shown in a batch: turned, then shifted, then mirrored, in another light."""

    yaws_rad: npt.NDArray[np.float64]
    """Turn of the robot to the left [rad], shape (G,)."""
    shifts_px: Indices
    """Rows and columns by which the image moves down and right, shape (G, 2)."""
    mirrored: npt.NDArray[np.bool_]
    """Shape (G,)."""
    light: Array
    """What the network is given for each byte of each colour, shape (G, 256, 3)."""


def draw_views(turnable: npt.NDArray[np.bool_], config: SamplingConfig, rng: np.random.Generator) -> View:
    """A random view of each episode.

    Args:
        turnable: False where the robot must not be turned, shape (G,).
        config: How far.
        rng: Random generator.
    """
    count = len(turnable)
    yaws_rad = config.yaw_error_rad * np.clip(rng.normal(0.0, 1.0, count), -2.5, 2.5)
    return View(
        yaws_rad=np.where(turnable, yaws_rad, 0.0),
        shifts_px=rng.integers(-config.shift_px, config.shift_px + 1, (count, 2)),
        mirrored=rng.random(count) < config.mirror,
        light=draw_light(count, config.photometric, rng),
    )


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


def plain_view() -> View:
    """What the camera saw, for a single episode or all of them."""
    zeros = np.zeros(1)
    return View(
        yaws_rad=zeros,
        shifts_px=np.zeros((1, 2), np.int64),
        mirrored=np.zeros(1, np.bool_),
        light=draw_light(1, 0.0, np.random.default_rng(0)),
    )


def draw_light(count: int, strength: float, rng: np.random.Generator) -> Array:
    """Contrast, brightness and colour of episodes, as tables from bytes to numbers around [-1, 1].

    Args:
        count: Number of episodes.
        strength: Largest relative change.
        rng: Random generator.

    Returns:
        Shape (count, 256, 3).
    """
    contrast = 1 + rng.uniform(-strength, strength, (count, 1, 1))
    colour = 1 + rng.uniform(-strength, strength, (count, 1, 3)) / 2
    brightness = rng.uniform(-strength, strength, (count, 1, 1))
    plain = (np.arange(256) / 127.5 - 1)[:, None]
    tables: Array = (contrast * colour * plain + brightness + colour - 1).astype(np.float32)
    return tables


class RobotWarp:
    """Shows the images of all cameras as `FrameWarp` shows those of one."""

    def __init__(self, robot: RobotConfig, images: Sequence[str], pooling: int = 1) -> None:
        """See `FrameWarp`.

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

    def show(self, frames: Sequence[Image], view: View, group: int, out: Sequence[Image]) -> None:
        """See `FrameWarp.show`; mirrored, a camera shows what its twin on the other side did."""
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
    edge is repeated there. A camera that is not above the robot's centre also moves a little, which is left out. What a
    sensor varies of a lens between episodes is left out as well.
    """

    def __init__(self, camera: CameraConfig, pooling: int = 1) -> None:
        self._lens = make_lens(camera)
        self._R_robot_camera = camera.T_world_camera(0.0, 0.0, 0.0, 0.0)[:3, :3]
        self._size = camera.width_px // pooling, camera.height_px // pooling
        self._pooling = pooling

    @cached_property
    def _rays(self) -> npt.NDArray[np.float64]:
        """What each pixel sees through the lens, shape (H W, 3)."""
        columns, rows = np.meshgrid(np.arange(self._size[0]) + 0.5, np.arange(self._size[1]) + 0.5)
        xy = self._lens.rays(self._pooling * np.stack([columns.ravel(), rows.ravel()], axis=1))
        return np.concatenate([xy, np.ones((len(xy), 1))], axis=1)

    def show(self, frames: Sequence[Image], view: View, group: int, out: Sequence[Image]) -> None:
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
            maps = self._turned_maps(yaw_rad)
            for frame, shown in zip(frames, out, strict=True):
                _move(_remapped(frame, maps), shift_px, mirrored, out=shown)

    def _warp(self, frame: Image, shown: Image, H: npt.NDArray[np.float64]) -> None:
        for part, how in _parts(frame.shape[2]):
            # OpenCV writes into whole arrays alone.
            whole = part == slice(0, frame.shape[2])
            source = frame if whole else np.ascontiguousarray(frame[..., part])
            target = shown if whole else np.empty_like(source)
            flags = how | cv2.WARP_INVERSE_MAP
            cv2.warpPerspective(source, H, self._size, dst=target, flags=flags, borderMode=cv2.BORDER_REPLICATE)
            if not whole:
                shown[..., part] = target

    def _rotation(self, yaw_rad: float) -> npt.NDArray[np.float64]:
        """From the turned camera's axes to those before, shape (3, 3)."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        R_before_after = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        R: npt.NDArray[np.float64] = self._R_robot_camera.T @ R_before_after @ self._R_robot_camera
        return R

    def _homography(self, yaw_rad: float) -> npt.NDArray[np.float64]:
        """Without a lens a rotation is a homography: from turned pixels to those before, shape (3, 3)."""
        # OpenCV's warp counts pixel centres from 0.
        K = np.diag([1 / self._pooling, 1 / self._pooling, 1.0]) @ self._lens.K_px
        K = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]]) @ K
        return np.asarray(K @ self._rotation(yaw_rad) @ np.linalg.inv(K), np.float64)

    def _turned_maps(self, yaw_rad: float) -> tuple[Array, Array]:
        """Through the lens: every pixel's ray, turned, and the pixel that saw it before."""
        x, y, ahead = (self._rays @ self._rotation(yaw_rad).T).T
        xy = np.stack([x, y], axis=1) / np.maximum(ahead, 1e-6)[:, None]
        # Beyond what the lens can show its polynomial would turn back into the image.
        xy *= np.minimum(1.0, self._lens.radius_max / np.maximum(np.hypot(xy[:, 0], xy[:, 1]), 1e-12))[:, None]
        pixels = self._lens.pixels(xy) / self._pooling - 0.5
        columns, rows = pixels.astype(np.float32).T.reshape(2, self._size[1], self._size[0])
        return columns, rows


def show_frames(frames: Image, groups: Indices, view: View, warps: Mapping[int, RobotWarp]) -> Image:
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


def _remapped(frame: Image, maps: tuple[Array, Array]) -> Image:
    """A frame whose pixels come from elsewhere in it."""
    turned = [
        cv2.remap(np.ascontiguousarray(frame[..., part]), *maps, how, borderMode=cv2.BORDER_REPLICATE)
        for part, how in _parts(frame.shape[2])
    ]
    return np.concatenate([np.asarray(one, np.uint8).reshape(*one.shape[:2], -1) for one in turned], axis=2)


def _moved_from(shift_px: Indices, mirrored: bool, size: tuple[int, int]) -> npt.NDArray[np.float64]:
    """From shifted and mirrored pixels to those before, shape (3, 3)."""
    mirror = np.array([[-1.0, 0.0, size[0] - 1], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) if mirrored else np.eye(3)
    return np.asarray(np.array([[1.0, 0.0, -shift_px[1]], [0.0, 1.0, -shift_px[0]], [0.0, 0.0, 1.0]]) @ mirror)


def _move(frame: Image, shift_px: Indices, mirrored: bool, *, out: Image) -> None:
    """Shift a frame down and right, its edge repeated, and mirror it then."""
    target = out[:, ::-1] if mirrored else out
    (down, right), (height, width) = shift_px.tolist(), frame.shape[:2]
    rows, columns = slice(max(down, 0), height + min(down, 0)), slice(max(right, 0), width + min(right, 0))
    target[rows, columns] = frame[max(-down, 0) : height - max(down, 0), max(-right, 0) : width - max(right, 0)]
    target[rows, : columns.start] = target[rows, columns.start : columns.start + 1]
    target[rows, columns.stop :] = target[rows, columns.stop - 1 : columns.stop]
    target[: rows.start] = target[rows.start]
    target[rows.stop :] = target[rows.stop - 1]


def lit(frames: Image, groups: Indices, light: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """What the network is given for frames.

    Args:
        frames: Frames, shape (F, H, W, C).
        groups: Row of each frame's episode in `light`, shape (F,).
        light: Tables from bytes, of float32 or of 16 bits that stand for bfloat16, shape (G, 256, C).

    Returns:
        Of the type of `light`, shape (F, H, W, C).
    """
    shown = np.empty(frames.shape, light.dtype)
    for row, group in enumerate(groups.tolist()):
        cv2.LUT(frames[row], light[group][None], dst=shown[row])
    return shown


def light_on(light: Array, images: Sequence[str]) -> Array:
    """Tables of the channels of some images: of colours the light's, of depths what changes nothing, (G, 256, C)."""
    if len(images) == 1:
        return light
    plain = np.broadcast_to(draw_light(1, 0.0, np.random.default_rng(0))[..., :1], (len(light), 256, 1))
    return np.concatenate([light if kind_of(name) == RGB else plain for name in images], axis=2)


def turn_world(xy_m: Array, yaws_rad: npt.NDArray[np.float64]) -> Array:
    """Places in the frames of robots that are turned to the left by `yaws_rad`, shape (B, 2)."""
    c, s = np.cos(yaws_rad), np.sin(yaws_rad)
    x, y = xy_m.T
    turned: Array = np.stack([c * x + s * y, c * y - s * x], axis=1).astype(np.float32)
    return turned


def turn_motion(motion: Array, yaws_rad: npt.NDArray[np.float64]) -> Array:
    """Own motion of robots that were turned to the left by `yaws_rad` at all of their frames, shape (B, 3 K + 2)."""
    turned = motion.copy()
    for begin in range(0, motion.shape[1] - 2, 3):
        turned[:, begin : begin + 2] = turn_world(motion[:, begin : begin + 2], yaws_rad)
    return turned


def mirrored_motion(width: int) -> Array:
    """Signs of the features of own motion in a mirrored world: of K older frames and the command, shape (3 K + 2,)."""
    return np.array([1, -1, -1] * ((width - 2) // 3) + [1, -1], np.float32)


def correct_for_turn(
    commands: Array,
    yaws_rad: npt.NDArray[np.float64],
    gain_per_s: float,
    w_max_radps: npt.NDArray[np.float64] | float,
) -> Array:
    """Commands of robots that were turned to the left by `yaws_rad`: they turn back.

    Args:
        commands: v [m/s], w [rad/s], shape (B, 2).
        yaws_rad: Turn of each robot [rad], shape (B,).
        gain_per_s: Turn rate per yaw error that brings the robot back [1/s].
        w_max_radps: Limit of the corrected turn rate [rad/s], shape (B,) or one for all.

    Source: Bojarski et al., End to end learning for self-driving cars, 2016 (rotated views with corrected steering).
    """
    corrected = commands.copy()
    turned = yaws_rad != 0
    w_radps = np.clip(commands[:, 1] - gain_per_s * yaws_rad, -w_max_radps, w_max_radps)
    corrected[turned, 1] = w_radps[turned]
    return corrected


@dataclass(frozen=True, kw_only=True, eq=False)
class Goals:
    """Goals of a batch."""

    xy_m: Array
    """In the robot's frame [m], shape (B, 2)."""
    seen_from: Indices
    """The sample whose frame shows what is seen there; -1 - e for the image of the goal of episode e, shape (B,)."""


def own_goals(table: SampleTable, samples: Indices) -> Goals:
    """The goals of the episodes."""
    return Goals(xy_m=table.goals_xy_m[samples], seen_from=-1 - table.episode[samples])


def hindsight_goals(
    table: SampleTable, samples: Indices, share: float, rng: np.random.Generator, *, seen: bool = False
) -> Goals:
    """Goals of samples, some of them replaced by a place that the robot reached later in the same episode.

    What the expert did was right for every place that it came to undisturbed, so that one episode teaches many goals.
    Places within `NEAR_M` are no goals: an episode ends before the robot is that near.

    Args:
        table: Poses, goals and episodes.
        samples: Sample indices, shape (B,).
        share: Probability that a sample's goal is replaced.
        rng: Random generator.
        seen: Take only places at which an image was taken.

    Source: Andrychowicz et al., Hindsight experience replay, 2017; Ghosh et al., Learning to reach goals via iterated
    supervised learning, 2019.
    """
    later = samples + np.ceil(rng.random(len(samples)) * (table.driven_last[samples] - samples)).astype(np.int64)
    later = table.pictured_at[later] if seen else later
    reached = goals_in_robot_frames(table.xyyaw[samples], table.xyyaw[later, :2]).astype(np.float32)
    dx, dy = (table.xyyaw[later, :2] - table.xyyaw[samples, :2]).T
    replaced = (rng.random(len(samples)) < share) & (dx * dx + dy * dy > NEAR_M**2)
    own = own_goals(table, samples)
    xy_m: Array = np.where(replaced[:, None], reached, own.xy_m)
    return Goals(xy_m=xy_m, seen_from=np.where(replaced, later, own.seen_from))


def corrupt_previous(commands: Array, noise: Array, withheld: npt.NDArray[np.bool_]) -> Array:
    """Previous actions as `MotionInput.COMMAND` has them, with noise, and withheld (0, 0, 0) in some samples.

    An imitator that sees the previous action learns to repeat it: consecutive actions of an expert hardly differ, and
    the copy scores well on recorded data but never starts or stops by itself.

    Args:
        commands: v [m/s], w [rad/s], shape (B, 2).
        noise: Added to them, shape (B, 2).
        withheld: Where the previous action is not known, shape (B,).

    Returns:
        Shape (B, 3).

    Source: Wen et al., Fighting copycat agents in behavioral cloning from observation histories, 2020.
    """
    known = np.concatenate([commands + noise, np.ones((len(commands), 1))], axis=1)
    return np.where(withheld[:, None], 0.0, known).astype(np.float32)
