"""The `gait` motion generator: a parametric walk whose feet stay where they step.

The root follows the trajectory, footsteps are planned beside it, the feet roll over heel and ball contacts that do not
move, and the legs follow by inverse kinematics. Speeds, cadences and joint curves are matched to CMU mocap
(mocap.cs.cmu.edu, NSF EIA-0196217).
"""

import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.frames import zup_from_yup
from readygo.common.maps.grid import FloorMap
from readygo.common.messages import Motion
from readygo.common.robot.kinematics import DT_S
from readygo.services.animator.gait.body import drive_of, pelvis_path, pelvis_rotations, pose_frames
from readygo.services.animator.gait.curves import Curves, default_curves, stride_rate
from readygo.services.animator.gait.feet import Feet, pose_foot
from readygo.services.animator.gait.human import GaitSkeleton, GaitStyle, draw_style
from readygo.services.animator.gait.math import Ground
from readygo.services.animator.gait.path import check_trajectory, extend, plan_track
from readygo.services.animator.gait.steps import ON, plan_contacts

SETTLED_AFTER_S = 0.35
SETTLE_MAX_S = 1.5
"""Longest time appended after a trajectory's end for the closing steps into a stand."""
STAND_S = 50.0
"""Length of the idle motion for a trajectory of one point [s]; afterwards its last pose is held."""


def _walk(
    x: Float64Array, z: Float64Array, skeleton: GaitSkeleton, style: GaitStyle, ground: Ground, curves: Curves
) -> tuple[Float64Array, Float64Array, float]:
    """Pelvis in the y-up world, pose, and the time of the last touch-down [s]."""
    track = plan_track(x, z, style, skeleton.size, curves)
    count = len(x)
    times_s = np.arange(count, dtype=np.float64) * DT_S
    feet = Feet(np.empty((2, count, 3)), np.empty((2, count, 3, 3)), np.empty((2, count, 3, 3)))
    last_s = 0.0
    for foot in range(2):
        contacts = plan_contacts(track, foot, skeleton, style, ground, curves)
        pose_foot(contacts, foot, skeleton, curves, times_s, feet)
        last_s = max(last_s, float(contacts[-1, ON]))
    drive = drive_of(track, style, skeleton.size, curves)
    R_pelvis = pelvis_rotations(track, drive, style)
    P = pelvis_path(track, drive, R_pelvis, feet, skeleton, style, ground)
    return P, pose_frames(track, drive, R_pelvis, P, feet, skeleton, style), last_s


def walk(
    skeleton: GaitSkeleton,
    trajectory_xy_m: Float64Array,
    floor: FloorMap,
    rng: np.random.Generator,
    style_variation: float = 1.0,
    curves: Curves | None = None,
) -> Motion:
    """A person who walks along a trajectory and then stands.

    Args:
        skeleton: Measures of the body, see `skeleton_of`.
        trajectory_xy_m: Ground position at 20 Hz in the z-up world [m], shape (T, 2). A trajectory that starts faster
            than 0.3 m/s begins in mid-gait, a slower one from a stand.
        floor: Height of the local floor.
        rng: Source of the person's style.
        style_variation: How much people differ, see `AnimatorConfig`: 0 (all alike) to 1.
        curves: How people walk; those of the package if None.

    Returns:
        The motion: at least T rows (50 s of them for a trajectory of one point), the pelvis above the trajectory, and
        after its end up to 1.5 s more until the person stands still.

    Raises:
        MotionError: If the trajectory is empty, not finite, or jumps faster than 5 m/s.
    """
    xy = np.asarray(trajectory_xy_m, dtype=np.float64)
    check_trajectory(xy)
    if len(xy) == 1:
        xy = np.repeat(xy, round(STAND_S / DT_S), axis=0)
    style = draw_style(rng, style_variation, skeleton.size)
    x, z, lead = extend(xy, style, 1.0 / float(stride_rate(1.2, skeleton.size, 0.0)), SETTLE_MAX_S)
    grid = floor.frame
    heights = np.array(floor.height_m, order="C")  # a copy: arrays out of messages are read-only, another type
    ground = Ground(heights, float(grid.origin_x_m), float(grid.origin_y_m), float(grid.resolution_m))
    P, pose, last_s = _walk(x, z, skeleton, style, ground, default_curves() if curves is None else curves)
    settled = math.ceil((last_s + SETTLED_AFTER_S) / DT_S) if last_s > 0.0 else 0
    end = min(max(lead + len(xy), settled), len(x))
    root = zup_from_yup(P[lead:end])
    return Motion(root_m=root.astype(np.float32), pose_axis_angle=pose[lead:end].astype(np.float32))
