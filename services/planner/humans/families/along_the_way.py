"""Families that any place has room for: across the robot's way, along it, against it, to its goal."""

import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.humans.families.site import Encounter, Site
from readygo.services.planner.humans.polyline import at_constant_speed, length_m
from readygo.services.planner.humans.robot_task import Point, RobotTask, apart_m, offset_point, rotate_left
from readygo.services.planner.humans.timing import Walk, cut_to_meet, first_rows, timed_to_meet

PASSING_M = 0.85
"""Least distance to the side at which a faster human overtakes the robot [m]: it cannot see who comes from behind."""
SLOWER, FASTER = 0.75, 1.3
"""Speeds of humans who are overtaken and who overtake, as shares of the robot's: at most and at least."""
_CROSSING_FRACTIONS = (0.3, 0.7)
"""Shares of the robot's path between which it is crossed."""
_CROSSING_ANGLES_RAD = (math.radians(45.0), math.radians(135.0))
"""Angles to the robot's path between which it is crossed [rad]."""
_MEETING_JITTER_S = 0.5
"""Standard deviation of the time between robot and human at the crossing [s]."""
_PARALLEL_OFFSET_M = 1.0
"""Largest lateral offset of a parallel human [m]."""
WALK_MIN_M = 1.0
"""Shorter walks are none [m]."""


def crossing(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """Across the robot's way at 45 to 135 degrees, cut so that both are there at the same time."""
    return _crossing(site, rng, task, None)


def crossing_left(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """As `crossing`, from the robot's left."""
    return _crossing(site, rng, task, -1.0)


def crossing_right(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """As `crossing`, from the robot's right."""
    return _crossing(site, rng, task, 1.0)


def _crossing(site: Site, rng: np.random.Generator, task: RobotTask, turn: float | None) -> Encounter:
    speed, fraction = site.speed_mps(rng), rng.uniform(*_CROSSING_FRACTIONS)
    angle = rng.uniform(*_CROSSING_ANGLES_RAD)
    if turn is None:
        turn = 1.0 if rng.random() < 0.5 else -1.0
    meeting_s = max(0.0, site.drive.time_s(fraction * task.length_m) + rng.normal(0.0, _MEETING_JITTER_S))
    before_m, after_m = min(max(speed * meeting_s, 1.5), 8.0), rng.uniform(2.0, 6.0)
    meeting, tangent = task.at(fraction)
    path = path_across(site, meeting, rotate_left(tangent, turn * angle), before_m, after_m)
    if path is None:
        return ()
    cut = cut_to_meet(path, meeting, speed * meeting_s, slack_m=speed * 1.0)
    if cut is None or length_m(cut) <= WALK_MIN_M:
        return ()
    return (Walk(speed_mps=speed, xy_m=at_constant_speed(cut, speed, DT_S)),)


def path_across(
    site: Site, meeting: Point, direction: Point, before_m: float, after_m: float, *, before_min_m: float | None = None
) -> Float64Array | None:
    """A path through a meeting point in a direction, as long before and after it as walls allow."""
    x, y = direction
    before_m = site.paths.reach_m(meeting, (-x, -y), before_m)
    after_m = site.paths.reach_m(meeting, direction, after_m)
    least_m = site.spacing.start_distance_min_m if before_min_m is None else before_min_m
    if before_m < least_m or after_m < 1.0:
        return None
    return site.paths.path(
        [offset_point(meeting, direction, -before_m), meeting, offset_point(meeting, direction, after_m)]
    )


def parallel(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """Beside the robot's way, with it or against it."""
    speed = site.speed_mps(rng)
    offset = rng.uniform(-_PARALLEL_OFFSET_M, _PARALLEL_OFFSET_M)
    same = rng.random() < 0.5
    start, tangent = task.at(0.0)
    goal, goal_tangent = task.at(1.0)
    if same:
        a = offset_point(start, tangent, rng.uniform(1.0, 3.0), offset)
        b = offset_point(goal, goal_tangent, rng.uniform(0.0, 2.0), offset)
    else:
        a = offset_point(goal, goal_tangent, rng.uniform(-1.0, 2.0), offset)
        b = offset_point(start, tangent, -rng.uniform(0.0, 2.0), offset)
    if not _is_fair(site, task, a, b):
        return ()
    path = site.paths.path([a, b])
    if path is None or length_m(path) <= WALK_MIN_M:
        return ()
    return (Walk(speed_mps=speed, xy_m=at_constant_speed(path, speed, DT_S)),)


def frontal(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """Towards the robot, on its own way."""
    speed, fraction = site.speed_mps(rng), rng.uniform(0.3, 0.7)
    offset = rng.uniform(-0.3, 0.3)
    meeting_s = site.drive.time_s(fraction * task.length_m)
    path = path_against(site, task, fraction, offset, speed * meeting_s, rng.uniform(2.0, 5.0))
    if path is None:
        return ()
    meeting = offset_point(*task.at(fraction), 0.0, offset)
    xy_m = timed_to_meet(path, meeting, meeting_s, speed)
    if xy_m is None or not is_frontal(site, task, xy_m):
        return ()
    return (Walk(speed_mps=speed, xy_m=xy_m),)


def is_frontal(site: Site, task: RobotTask, xy_m: Float64Array) -> bool:
    """True if a human comes within 0.6 m of the robot, walking against its direction within 45 degrees."""
    step, gap_m = site.nearest_to_robot(task, xy_m)
    return gap_m <= 0.6 and _turn_rad(site, task, xy_m, step) >= math.radians(135)


def path_against(
    site: Site, task: RobotTask, fraction: float, offset_m: float, before_m: float, after_m: float
) -> Float64Array | None:
    """A path along the robot's way, backwards, `offset_m` to the left of it, past a fraction of the way.

    It begins `before_m` behind that place, also beyond the goal, and ends `after_m` past it, also before the start.
    """
    a = _along(site, task, fraction * task.length_m + before_m, offset_m)
    b = _along(site, task, fraction * task.length_m - after_m, offset_m)
    via = site.paths.nearest_walkable(offset_point(*task.at(fraction), 0.0, offset_m), 0.3)
    if a is None or b is None or via is None or not _is_fair(site, task, a, b):
        return None
    return site.paths.path([a, via, b])


def overtaking(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """A human on the robot's way: slower, ahead of it, or faster, from behind and well to the side."""
    robot_mps, low, high = (
        site.drive.speed_mps,
        site.episode.human_speed_min_mps,
        site.episode.human_speed_max_mps,
    )
    slow, fast = low <= SLOWER * robot_mps, high >= FASTER * robot_mps
    if not (slow or fast):
        return ()
    if slow and (not fast or rng.random() < 0.5):
        speed = rng.uniform(low, min(high, SLOWER * robot_mps))
        ahead_m, offset = rng.uniform(1.6, 3.0), rng.uniform(-0.4, 0.4)
    else:
        speed = rng.uniform(max(low, FASTER * robot_mps), high)
        ahead_m, offset = -rng.uniform(1.6, 4.0), rng.uniform(PASSING_M, 1.15) * (1 if rng.random() < 0.5 else -1)
    a = _along(site, task, ahead_m, offset)
    via = site.paths.nearest_walkable(offset_point(*task.at(0.5), 0.0, offset), 0.2)
    short_m = rng.uniform(0.1, 1.5)
    b = _along(site, task, task.length_m + rng.uniform(1.7, 3.0), offset)
    if b is None or apart_m(b, task.goal_m) < site.spacing.parked_distance_min_m:
        # No room beyond the goal: they stop before it.
        b = _along(site, task, task.length_m - site.spacing.parked_distance_min_m - short_m, offset)
    if a is None or b is None or via is None or not _is_fair(site, task, a, b):
        return ()
    path = site.paths.path([a, via, b], detour_max=1.3)
    if path is None:
        return ()
    xy_m = at_constant_speed(path, speed, DT_S)
    return (Walk(speed_mps=speed, xy_m=xy_m),) if is_overtaking(site, task, xy_m) else ()


def is_overtaking(site: Site, task: RobotTask, xy_m: Float64Array) -> bool:
    """True if one gets from behind the other to ahead of it on the first 85 % of the way, beside it, with its heading.

    The one that comes from behind keeps to the side.
    """
    count = math.ceil(site.drive.time_s(0.85 * task.length_m) / DT_S) + 1
    gap = first_rows(xy_m, count) - site.drive.rows(task, count)
    ahead = site.drive.directions(task, count)
    side = gap[:, 0] * ahead[:, 0] + gap[:, 1] * ahead[:, 1] > 0
    changes = np.flatnonzero(side[1:] != side[:-1])
    if len(changes) != 1:
        return False
    step = int(changes[0])
    away_m = math.hypot(*gap[step].tolist())
    least_m = 0.0 if side[0] else PASSING_M - 0.1
    return least_m <= away_m <= 1.5 and _turn_rad(site, task, xy_m, step) <= math.radians(45)


def goalward(site: Site, rng: np.random.Generator, task: RobotTask, wanted: int) -> Encounter:
    """To the robot's goal from elsewhere and past it, there when the robot arrives or a little earlier."""
    speed = site.speed_mps(rng)
    angle = rng.uniform(math.radians(40), math.pi) * (1.0 if rng.random() < 0.5 else -1.0)
    goal, tangent = task.at(1.0)
    via = site.paths.nearest_walkable(goal, 0.3)
    arrival_s = max(1.0, site.drive.time_s(task.length_m) + rng.uniform(-2.5, 0.5))
    after_m = rng.uniform(1.8, 3.5)
    if via is None:
        return ()
    path = path_across(site, via, rotate_left(tangent, angle), min(speed * arrival_s, 8.0), after_m, before_min_m=2.5)
    if path is None or apart_m(tuple(path[-1].tolist()), task.goal_m) < site.spacing.parked_distance_min_m:
        return ()
    xy_m = timed_to_meet(path, via, arrival_s, speed)
    if xy_m is None or not is_goalward(site, task, xy_m):
        return ()
    return (Walk(speed_mps=speed, xy_m=xy_m),)


def is_goalward(site: Site, task: RobotTask, xy_m: Float64Array) -> bool:
    """True if a human starts 2 m or more from the goal and passes it within 0.7 m, near the robot's arrival."""
    gap = xy_m - np.array(task.goal_m)
    away = np.sqrt(gap[:, 0] ** 2 + gap[:, 1] ** 2)
    step = int(np.argmin(away))
    late_s = step * DT_S - site.drive.time_s(task.length_m)
    return bool(away[0] >= 2.0 and away[step] <= 0.7 and -3.0 <= late_s <= 1.0)


def _along(site: Site, task: RobotTask, along_m: float, offset_m: float) -> Point | None:
    """A walkable place along the robot's way, also before its start and beyond its goal, to the left of it."""
    inside_m = min(max(along_m, 0.0), task.length_m)
    base, tangent = task.at(inside_m / task.length_m)
    beside = site.paths.nearest_walkable(offset_point(base, tangent, 0.0, offset_m), 0.3)
    beyond_m = along_m - inside_m
    if beside is None or beyond_m == 0:
        return beside
    forward = 1.0 if beyond_m > 0 else -1.0
    direction = (forward * tangent[0], forward * tangent[1])
    return offset_point(beside, direction, site.paths.reach_m(beside, direction, abs(beyond_m)))


def _is_fair(site: Site, task: RobotTask, start: Point, end: Point) -> bool:
    """True if a human starts away from the robot and ends away from its goal; asked before a slow search."""
    away = apart_m(start, task.start_m) >= site.spacing.start_distance_min_m
    return away and apart_m(end, task.goal_m) >= site.spacing.parked_distance_min_m


def _turn_rad(site: Site, task: RobotTask, xy_m: Float64Array, step: int) -> float:
    """Angle between the headings of robot and human around a step [rad]: 0 the same, pi opposite, pi/2 standing."""
    a, b = max(step - 5, 0), step + 5
    walked = first_rows(xy_m, b + 1)
    (rx, ry), (hx, hy) = site.drive.directions(task, step + 1)[step].tolist(), (walked[b] - walked[a]).tolist()
    if math.hypot(hx, hy) < 0.1:
        return 0.5 * math.pi
    return abs(math.atan2(rx * hy - ry * hx, rx * hx + ry * hy))
