"""The camera of an episode: which sub-frames, seen through which lens and weighted how, make each of its images.

Random numbers come from one Philox key per episode and camera, a block of its counter for each image: images can be
drawn in any order.
"""

import dataclasses
import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.lens import make_lens
from readygo.common.episode.robot import robot_of_episode
from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.maps import FloorMap
from readygo.common.messages import EpisodeKey, FurtherCamera, HumanMotion
from readygo.common.rasterizer.interface import PosedHuman
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S
from readygo.services.renderer.faces import Faces, Remap, plan_faces
from readygo.services.renderer.humans import pose_humans, row_and_share

PhiloxKey = tuple[int, int]
"""Two 64-bit words."""

TIME_ONE = 1 << 12
"""Sum of the weights of the sub-frames that a row is made of."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shutter:
    """The sub-frames that an image is made of, and the share of each in each row."""

    steps: tuple[float, ...]
    """Times at which sub-frames are drawn, in simulation steps after the image's own step, at most 0; M of them, latest
    last."""
    weight: Int64Array
    """Shares in 1/`TIME_ONE`; columns sum to that, shape (M, H)."""
    middle: Int64Array
    """The sub-frame nearest to the middle of each row's exposure, shape (H,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SubFrame:
    """What an image shows at one time of its exposure."""

    T_world_camera: Float64Array
    """Camera pose, OpenCV axes, shape (4, 4)."""
    humans: tuple[PosedHuman, ...]
    weight: Int64Array
    """Its share in each row in 1/`TIME_ONE`, shape (H,)."""
    rows: BoolArray
    """The rows whose exposure has its middle here, shape (H,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeCamera:
    """One of the robot's cameras, with the values that its sensor drew for an episode."""

    name: str
    """The camera's name; empty for the robot's first one."""
    config: CameraConfig
    shutter: Shutter
    gain: Float64Array
    """Factor on the light of each pixel, see `exposure_gain`, shape (H, W)."""
    key: PhiloxKey
    """Key of the sensor's random numbers."""
    remap: Remap | None = None
    """The lens; None if the rasterizer draws the image itself."""
    K_px: Float64Array | None = None
    """Intrinsics [px] that replace the rasterizer's, shape (3, 3)."""

    def sub_frames(self, shot: "Shot") -> list[SubFrame]:
        """The sub-frames of an image, earliest first; equal neighbours become one."""
        found: list[SubFrame] = []
        for index, after in enumerate(self.shutter.steps):
            step = shot.step if shot.still else shot.step + after
            sub_frame = SubFrame(
                T_world_camera=shot.pose_at(self, step),
                humans=pose_humans(shot.humans, step),
                weight=self.shutter.weight[index],
                rows=self.shutter.middle == index,
            )
            if found and _shows_the_same(found[-1], sub_frame):
                weight, rows = found[-1].weight + sub_frame.weight, found[-1].rows | sub_frame.rows
                found[-1] = dataclasses.replace(found[-1], weight=weight, rows=rows)
            else:
                found.append(sub_frame)
        return found


PoseAt = Callable[[EpisodeCamera, float], Float64Array]
"""Pose of a camera at a simulation step, which need not be whole, shape (4, 4)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """A time at which the robot's cameras take an image."""

    step: int
    """The image's simulation step, at which its last row's exposure ends."""
    pose_at: PoseAt
    """Where the cameras are over time."""
    humans: tuple[HumanMotion, ...] = ()
    episode: EpisodeKey | str = ""
    """The episode whose cameras look; views of no episode have a text instead, from which the sensor draws."""
    still: bool = False
    """True if nothing moves during the exposure."""
    exposure_ev: float | None = None
    """Exposure [stops] instead of the camera's."""


def path_poses(xyyaw: Float64Array, floor: FloorMap, first_step: int = 0) -> PoseAt:
    """Poses of cameras on a robot; before the first row and after the last one it stands still.

    Args:
        xyyaw: The robot at each step from `first_step` on: x [m], y [m], yaw [rad] (not wrapped), shape (T, 3).
        floor: Height of the floor.
        first_step: Step of the first row.
    """

    def pose_at(camera: EpisodeCamera, step: float) -> Float64Array:
        row, share = row_and_share(step, first_step + len(xyyaw))
        row, share = (row - first_step, share) if row >= first_step else (0, 0.0)
        pose = xyyaw[row] if share == 0.0 else arc(xyyaw[row], xyyaw[row + 1], share)
        x_m, y_m, yaw_rad = (float(value) for value in pose)
        return camera.config.T_world_camera(x_m, y_m, yaw_rad, floor.at(x_m, y_m))

    return pose_at


def arc(first: Float64Array, last: Float64Array, share: float) -> tuple[float, float, float]:
    """Pose (x, y, yaw) after a share of the constant twist that carries one planar pose to another.

    Between two samples of a unicycle that keeps its command this is the arc that it drives.
    Source: Lynch & Park, Modern Robotics, 2017, section 3.3.3 (exponential coordinates), in the plane.
    """
    x0, y0, yaw0 = (float(value) for value in first)
    x1, y1, yaw1 = (float(value) for value in last)
    half = 0.5 * (yaw1 - yaw0)
    # The chord of a part of the arc is to the whole chord as the sines of the half angles, and turned between them.
    part = share * half
    length = math.sin(part) / math.sin(half) if abs(half) > 1e-9 else share
    turn = part - half
    dx, dy = length * (x1 - x0), length * (y1 - y0)
    c, s = math.cos(turn), math.sin(turn)
    return x0 + c * dx - s * dy, y0 + s * dx + c * dy, yaw0 + 2.0 * part


def pinhole_of(sensor: SensorConfig, camera: CameraConfig) -> Faces | CameraConfig:
    """The pinhole camera that the rasterizer draws with: the camera itself, or faces for all lenses of its ranges.

    Raises:
        ConfigError: If a lens cannot be drawn.
    """
    if camera.distortion == "none":
        return camera
    return plan_faces([make_lens(extreme) for extreme in sensor.extremes(camera)])


def make_shutter(camera: CameraConfig, sub_frames: int, dt_s: float = DT_S) -> Shutter:
    """The shutter of a camera, its images made of `sub_frames` sub-frames, where a simulated step lasts `dt_s` [s].

    The last row's exposure ends at the image's own time, so that no pixel knows what the robot does afterwards: that is
    the action to be learned. The time from the first row's start to there is split into equal parts, each of them
    drawn at its middle, and a row takes from each what overlaps with its exposure.
    """
    height_px, span_s = camera.height_px, camera.exposure_s + camera.readout_s
    if span_s == 0.0:
        one = np.full((1, height_px), TIME_ONE, dtype=np.int64)
        return Shutter(steps=(0.0,), weight=one, middle=np.zeros(height_px, dtype=np.int64))
    part_s = span_s / sub_frames
    begins = [camera.readout_s * row / max(height_px - 1, 1) for row in range(height_px)]
    shares = [_row_shares(begin_s / part_s, camera.exposure_s / part_s, sub_frames) for begin_s in begins]
    middles = [min(int((begin_s + 0.5 * camera.exposure_s) / part_s), sub_frames - 1) for begin_s in begins]
    return Shutter(
        steps=tuple(((index + 0.5) * part_s - span_s) / dt_s for index in range(sub_frames)),
        weight=np.array(shares, dtype=np.int64).T.copy(),
        middle=np.array(middles, dtype=np.int64),
    )


def _row_shares(begin: float, length: float, count: int) -> list[int]:
    """Overlaps of [begin, begin + length] with the unit intervals from 0 to `count`, as integers of sum `TIME_ONE`."""
    if length < 1e-6:
        return [TIME_ONE * (index == min(int(begin), count - 1)) for index in range(count)]
    until = [min(max((index + 1 - begin) / length, 0.0), 1.0) for index in range(count)]
    until[-1] = 1.0
    steps = [math.floor(share * TIME_ONE + 0.5) for share in until]
    return [last - first for first, last in zip([0, *steps], steps, strict=False)]


def exposure_gain(camera: CameraConfig) -> Float64Array:
    """Factor on the light of each pixel from exposure and vignetting, shape (H, W)."""
    height_px, width_px = camera.height_px, camera.width_px
    u = (np.arange(width_px) + 0.5 - 0.5 * width_px)[None, :]
    v = (np.arange(height_px) + 0.5 - 0.5 * height_px)[:, None]
    corner2 = 0.25 * (height_px * height_px + width_px * width_px)
    gain: Float64Array = 2.0**camera.exposure_ev * (1.0 - camera.vignetting * (u * u + v * v) / corner2)
    return gain


def sensor_key(episode: EpisodeKey | str, camera: str = "") -> PhiloxKey:
    """Key of the random numbers of one camera's sensor in one episode.

    Args:
        episode: The episode, or a text that stands for one.
        camera: The camera's name; the robot's first one, called "", has the episode's key.
    """
    if isinstance(episode, str):
        digest = hashlib.sha256(episode.encode()).digest()
        key = int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")
    else:
        words = episode_rng(episode, Purpose.SENSOR).bit_generator.state["state"]["key"]
        key = int(words[0]), int(words[1])
    return sensor_key(f"{camera} {key}") if camera else key


def sensor_rng(key: PhiloxKey, step: int | None = None) -> np.random.Generator:
    """Random generator for the noise of the image of a step; without one, for the values that hold over an episode."""
    # A block has 2^192 counter values: no two of them ever meet.
    counter = np.array([0, 0, 0, 0 if step is None else step + 1], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=np.array(key, dtype=np.uint64), counter=counter))


def calibrations(robot: RobotConfig, sensor: SensorConfig, episode: EpisodeKey) -> tuple[FurtherCamera, ...]:
    """What is constant of a robot's cameras over an episode, the first one, called "", before the others.

    Args:
        robot: The run's robot, with its ranges.
        sensor: What varies of its cameras from episode to episode.
        episode: Key of the episode.
    """
    own = robot_of_episode(robot, episode)
    drawn = {
        name: sensor.draw_camera(camera, sensor_rng(sensor_key(episode, name)))
        for name, camera in {"": own.camera, **own.cameras}.items()
    }
    return tuple(
        FurtherCamera(
            name=name,
            height_px=camera.height_px,
            width_px=camera.width_px,
            K_px=tuple(camera.K_px.ravel().tolist()),
            distortion_model=camera.distortion_model,
            distortion=camera.coefficients,
        )
        for name, camera in drawn.items()
    )


def _shows_the_same(one: SubFrame, two: SubFrame) -> bool:
    """True if two sub-frames of an image, with the same humans, show them in the same poses from the same place."""
    pairs = zip(one.humans, two.humans, strict=True)
    return np.array_equal(one.T_world_camera, two.T_world_camera) and all(a.equals(b) for a, b in pairs)
