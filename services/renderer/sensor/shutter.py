"""When each row of an image collects light."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.camera import CameraConfig
from readygo.common.robot.kinematics import DT_S
from readygo.services.renderer.sensor.light import TIME_ONE


@dataclass(frozen=True, kw_only=True, eq=False)
class Shutter:
    """The images that one frame is made of, and the share of each in each row."""

    steps: tuple[float, ...]
    """Times at which images are drawn, in simulation steps after the frame's own step, at most 0; M of them, latest
    last."""
    weight: npt.NDArray[np.int64]
    """Shares in 1/`TIME_ONE`; columns sum to that, shape (M, H)."""
    middle: npt.NDArray[np.int64]
    """The image nearest to the middle of each row's exposure, shape (H,)."""


def make_shutter(camera: CameraConfig, sub_frames: int, dt_s: float = DT_S) -> Shutter:
    """The shutter of a camera, its frames made of `sub_frames` images, where a simulated step lasts `dt_s` [s].

    The last row's exposure ends at the frame's own time, so that no pixel knows what the robot does afterwards: that is
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
