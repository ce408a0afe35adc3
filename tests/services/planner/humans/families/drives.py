"""Where the robot is expected, reckoned anew: from its way, at 0.85 of its top speed after half a second."""

import math

import numpy as np

ROBOT_MPS, GETTING_GOING_S = 0.85, 0.5


def robot_at(way, count):
    """Where the robot is expected at each step, and which way it goes."""
    along = np.r_[0, np.cumsum(np.hypot(*np.diff(way, axis=0).T))]
    metres = np.clip((np.arange(count) * 0.05 - GETTING_GOING_S) * ROBOT_MPS, 0, along[-1])

    def at(s):
        return np.stack([np.interp(s, along, way[:, k]) for k in range(2)], axis=1)

    return at(metres), at(np.minimum(metres + 0.25, along[-1])) - at(np.maximum(metres - 0.25, 0)), along[-1]


def held(xy, count):
    return xy[np.minimum(np.arange(count), len(xy) - 1)]


def arrival_s(way):
    return robot_at(way, 2)[2] / ROBOT_MPS + GETTING_GOING_S


def meeting(xy, way):
    """Step of the nearest approach, gap [m], angle between the headings [deg]."""
    count = max(len(xy), int(arrival_s(way) / 0.05) + 2)
    robot, ahead, _ = robot_at(way, count)
    person = held(xy, count)
    step = int(np.argmin(np.hypot(*(person - robot).T)))
    walk = person[min(step + 5, count - 1)] - person[max(step - 5, 0)]
    turn = math.degrees(math.atan2(*walk[::-1]) - math.atan2(*ahead[step][::-1]))
    return step, float(np.hypot(*(person - robot)[step])), abs((turn + 180) % 360 - 180)
