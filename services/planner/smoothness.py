"""Whether a policy can learn a run: how much the turn rate jumps, and how briskly the robot drives where it is free."""

import math

from common.messages import RobotTrajectory
from common.robot.kinematics import DT_S, RATE_HZ

_FREE_M = 3.0


def mean_dw_radps2(trajectory: RobotTrajectory) -> float:
    """Mean absolute change of the turn rate, from rest on [rad/s per s]; 0 for an empty run."""
    w = trajectory.actions[:, 1].tolist()
    if not w:
        return 0.0
    return math.fsum(abs(b - a) for a, b in zip([0.0, *w[:-1]], w, strict=True)) / (len(w) * DT_S)


def free_speed_mps(trajectory: RobotTrajectory) -> float:
    """Mean speed after the first second where no human is in view or within 3 m [m/s]; nan if that is nowhere."""
    free = ~trajectory.human_visible & (trajectory.human_distance_m > _FREE_M)
    free[:RATE_HZ] = False
    speeds = trajectory.actions[free, 0].tolist()
    return math.fsum(speeds) / len(speeds) if speeds else math.nan
