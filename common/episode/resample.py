"""Motions with the rows of another rate."""

import math
from fractions import Fraction

import numpy as np

from readygo.common.frames.turning import turn_between
from readygo.common.messages import Motion


def place_between(step: int, rate_hz: int, rows_hz: int) -> tuple[int, float]:
    """The row, of `rows_hz` a second, that is before a step of `rate_hz`, and the share of the way to the next one."""
    place = Fraction(step * rows_hz, rate_hz)
    row = math.floor(place)
    return row, float(place - row)


def at_rate(motion: Motion, rate_hz: int) -> Motion:
    """A motion with another number of rows per second: the root moves straight between rows, joints turn evenly.

    A motion of that rate is returned itself.
    """
    if motion.rate_hz == rate_hz:
        return motion
    last = len(motion.root_m) - 1
    count = math.ceil(last * rate_hz / motion.rate_hz) + 1
    root_m, poses = np.empty((count, 3), np.float32), np.empty((count, 24, 3), np.float32)
    for step in range(count):
        row, share = place_between(step, rate_hz, motion.rate_hz)
        here, there = min(row, last), min(row + 1, last)
        root_m[step] = motion.root_m[here] + np.float32(share) * (motion.root_m[there] - motion.root_m[here])
        turn_between(motion.pose_axis_angle[here], motion.pose_axis_angle[there], share, poses[step])
    return Motion(root_m=root_m, pose_axis_angle=poses, rate_hz=rate_hz)
