"""Families that need a suitable place: blind corners, doorways, groups that stand, walkers that pause."""

import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.humans.families.along_the_way import path_across, path_against
from readygo.services.planner.humans.families.site import Encounter, Site
from readygo.services.planner.humans.robot_task import Point, RobotTask, apart_m, offset_point, rotate_left
from readygo.services.planner.humans.timing import (
    ACCELERATION_MPS2,
    Walk,
    first_rows,
    nearest_along,
    time_path,
    timed_to_meet,
)

_HIDDEN_UNTIL_S = 2.0
"""A human who comes round a blind corner is hidden from the robot's expected path until this long before they meet
[s]."""
_PAUSES_S = (1.5, 4.0)
"""Shortest and longest pause of humans who stop and go [s]."""
_GROUP_STEP_M = 0.35
_GROUP_SPEED_MPS = 0.5


def blind_corner(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """Out from behind an obstacle: hidden from the robot's expected way until shortly before the meeting."""
    speed, hidden_s = site.speed_mps(rng), _HIDDEN_UNTIL_S
    fraction = rng.uniform(0.25, 0.85)
    angle = rng.uniform(math.radians(40), math.radians(140)) * (1.0 if rng.random() < 0.5 else -1.0)
    meeting, tangent = task.at(fraction)
    direction = rotate_left(tangent, angle)
    meeting_s = site.drive.time_s(fraction * task.length_m)
    behind = offset_point(meeting, direction, -speed * hidden_s)
    if not site.paths.component(behind):
        return ()
    robot, _ = task.at(site.drive.along_m(meeting_s - hidden_s) / task.length_m)
    if site.sees(robot, behind):
        return ()
    path = path_across(site, meeting, direction, speed * meeting_s, rng.uniform(1.5, 4.0))
    xy_m = None if path is None else timed_to_meet(path, meeting, meeting_s, speed)
    if xy_m is None or not is_blind_corner(site, task, xy_m):
        return ()
    return (Walk(speed_mps=speed, xy_m=xy_m),)


def is_blind_corner(site: Site, task: RobotTask, xy_m: Float64Array) -> bool:
    """True if robot and human come within 0.7 m, and nothing of the human is in sight until shortly before."""
    step, gap_m = site.nearest_to_robot(task, xy_m)
    first = max(step - round(_HIDDEN_UNTIL_S / DT_S), 0)
    if gap_m > 0.7 or first == 0:
        return False
    robot, human = site.drive.rows(task, first).tolist(), first_rows(xy_m, first).tolist()
    # From the last moment on: that is where most who are seen are seen.
    return not any(site.sees(tuple(robot[k]), tuple(human[k])) for k in reversed(range(first)))


def doorway(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """Through a narrow passage on the robot's way, from the other side, both there at the same time."""
    on_way = site.passages_on_way(task)
    if not on_way:
        return ()
    middle, along_m = on_way[int(rng.integers(len(on_way)))]
    speed = site.speed_mps(rng)
    meeting_s = site.drive.time_s(along_m) + rng.uniform(-0.7, 0.7)
    before_m, after_m = min(speed * meeting_s, 8.0), rng.uniform(1.5, 4.0)
    fraction = along_m / task.length_m
    if rng.random() < 0.5:
        path = path_against(site, task, fraction, 0.0, before_m, after_m)
    else:
        _, tangent = task.at(fraction)
        path = _path_through(site, rng, middle, tangent, before_m, after_m)
    xy_m = None if path is None else timed_to_meet(path, middle, meeting_s, speed)
    if xy_m is None or not is_doorway(site, task, xy_m):
        return ()
    return (Walk(speed_mps=speed, xy_m=xy_m),)


def _path_through(
    site: Site, rng: np.random.Generator, middle: Point, tangent: Point, before_m: float, after_m: float
) -> Float64Array | None:
    """A path through a passage from its far side, with a bend of up to 70 degrees on either side."""
    bend = math.radians(70)
    far, near = rotate_left(tangent, rng.uniform(-bend, bend)), rotate_left(tangent, math.pi + rng.uniform(-bend, bend))
    before_m, after_m = site.paths.reach_m(middle, far, before_m), site.paths.reach_m(middle, near, after_m)
    if before_m < 1.0 or after_m < 1.0:
        return None
    return site.paths.path([offset_point(middle, far, before_m), middle, offset_point(middle, near, after_m)])


def is_doorway(site: Site, task: RobotTask, xy_m: Float64Array) -> bool:
    """True if robot and human are in one passage within a second of each other, against each other."""
    for middle, along_m in site.passages_on_way(task):
        gaps = xy_m - np.array(middle)
        squared = gaps[:, 0] ** 2 + gaps[:, 1] ** 2
        step = int(np.argmin(squared))
        if squared[step] > 0.4**2 or abs(step * DT_S - site.drive.time_s(along_m)) > 1.0:
            continue
        a, b = xy_m[max(step - 5, 0)], xy_m[min(step + 5, len(xy_m) - 1)]
        _, tangent = task.at(along_m / task.length_m)
        if float((b - a)[0]) * tangent[0] + float((b - a)[1]) * tangent[1] < 0:
            return True
    return False


def standing_group(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """Two to four humans in a circle near the way. They step up to it in the first second, and so face its middle."""
    if wanted < 2:
        return ()
    count = int(rng.integers(2, min(wanted, 4) + 1))
    point, tangent = task.at(rng.uniform(0.25, 0.75))
    side = 1.0 if rng.random() < 0.5 else -1.0
    radius_m = rng.uniform(0.45, 0.6) if count == 2 else rng.uniform(0.6, 0.8)
    centre = offset_point(point, tangent, 0.0, side * rng.uniform(radius_m, radius_m + 0.9))
    first, gaps = rng.uniform(-math.pi, math.pi), rng.uniform(-0.2, 0.2, count)
    group = []
    for k in range(count):
        angle = first + 2 * math.pi * k / count + float(gaps[k])
        outward = (math.cos(angle), math.sin(angle))
        place, outside = (
            offset_point(centre, outward, radius_m),
            offset_point(centre, outward, radius_m + _GROUP_STEP_M),
        )
        region = site.paths.component(centre)
        if not region or not region == site.paths.component(place) == site.paths.component(outside):
            return ()
        apart = apart_m(outside, task.start_m) >= site.spacing.start_distance_min_m
        if not apart or apart_m(place, task.goal_m) < site.spacing.parked_distance_min_m:
            return ()
        step = time_path(np.array([outside, place]), _GROUP_SPEED_MPS, wait_s=rng.uniform(0.1, 0.8))
        group.append(Walk(speed_mps=_GROUP_SPEED_MPS, xy_m=step))
    return tuple(group)


def stop_and_go(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """Across the way or against it, with a pause on it or shortly before."""
    speed, fraction = site.speed_mps(rng), rng.uniform(0.3, 0.7)
    pause_s = rng.uniform(*_PAUSES_S)
    early_s, short_m = rng.uniform(0.0, 2.0), rng.uniform(0.0, 1.0)
    meeting_s = site.drive.time_s(fraction * task.length_m)
    meeting, tangent = task.at(fraction)
    if rng.random() < 0.7:
        angle = rng.uniform(math.radians(45), math.radians(135)) * (1.0 if rng.random() < 0.5 else -1.0)
        path = path_across(site, meeting, rotate_left(tangent, angle), speed * meeting_s, rng.uniform(2.0, 5.0))
    else:
        path = path_against(site, task, fraction, rng.uniform(-0.4, 0.4), speed * meeting_s, rng.uniform(2.0, 5.0))
    if path is None:
        return ()
    even, nearest, spacing_m = nearest_along(path, meeting)
    stop_m, arrival_s = nearest * spacing_m - short_m, meeting_s - early_s
    # From full speed a stop takes this much longer than passing.
    cut_m = max(0.0, stop_m - speed * max(arrival_s - 0.5 * speed / ACCELERATION_MPS2, 0.0))
    first = int(cut_m / spacing_m)
    before_m, after_m = stop_m - first * spacing_m, (len(even) - 1) * spacing_m - stop_m
    if before_m < 1.2 or after_m < 1.0:
        return ()
    return (Walk(speed_mps=speed, xy_m=time_path(even[first:], speed, pauses=[(before_m, pause_s)])),)
