"""Pictures of episodes: the map from above, who went where, what the expert knew, and how it ended."""

from collections.abc import Callable

import cv2
import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.drawing import plan_view
from readygo.common.drawing.plan_view import GOAL, INK, ROBOT, WHITE, Rgb
from readygo.common.drawing.sheet import (
    GAP_PX,
    Swatch,
    area_swatch,
    dotted_swatch,
    line_swatch,
    ring_swatch,
    sheet,
    stack_panels,
)
from readygo.common.episode import EpisodeConfig
from readygo.common.maps import OccupancyMap
from readygo.common.messages import EpisodeMotions, RobotTrajectory, Scenario
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import RATE_HZ
from readygo.common.scenes.top_view import TopView
from readygo.services.planner.expert.handlers import RobotPlanner
from readygo.services.planner.explain.journal import DrivenRun
from readygo.services.planner.explain.moments import RunMoment, pick_moments
from readygo.services.planner.explain.picture_layers import (
    ADVICE,
    EXPECTED_SHARE,
    OUTCOMES,
    SIGHT,
    SIGHT_SHARE,
    SUPERSEDED,
    draw_changes,
    draw_closest,
    draw_knowledge,
    draw_superseded,
    draw_way,
    human_colour,
    put_diamond,
)

Look = Callable[[int], UInt8Array]
"""What the robot's camera shows at a step of a run, shape (H, W, 3)."""

SIDE_MAX_PX, SCALE_MAX_PX_PER_M = 1100, 85
BELOW_HEIGHT_PX = 620
"""Height of the episode's picture with the moments below it."""
SIDE_PX = (710, 560)
"""Width of the episode's picture with the moments beside it, and its least height."""
MOMENT_PX, MOMENT_M = 350, 7.0
"""Side of the picture of a moment [px], and what it shows [m]."""
NUMBER_APART_PX = 21
AHEAD_M = 1.5
"""A moment's picture is centred this far ahead of the robot [m]."""


def draw_episode(
    robot_map: OccupancyMap,
    scenario: Scenario,
    trajectory: RobotTrajectory | None = None,
    *,
    motions: EpisodeMotions | None = None,
    robot: RobotConfig | None = None,
    episode_config: EpisodeConfig | None = None,
) -> UInt8Array:
    """Draw an episode from above, x to the right and y up.

    Args:
        robot_map: What blocks the robot.
        scenario: Start, goal and humans.
        trajectory: The robot's run; without it only the scenario is drawn.
        motions: Draws the humans where their motions are, not where they were meant to go.
        robot: For the radius of its disc.
        episode_config: For the circle of success and the humans' radius.

    Returns:
        RGB image, shape (H, W, 3). Dots mark seconds; discs show where everybody is in the end.
    """
    view = episode_view(robot_map, scenario, trajectory, motions=motions)
    picture = view.rgb.copy()
    draw_ways(picture, view, scenario, trajectory, motions, robot or RobotConfig(), episode_config or EpisodeConfig())
    plan_view.draw_scale_bar(picture, view)
    return sheet([[picture]], _headline(scenario, trajectory, None), _legend(scenario, trajectory, None))


def draw_run(planner: RobotPlanner, run: DrivenRun, look: Look | None = None) -> UInt8Array:
    """Draw what the robot did and why: the episode, the expert's changes of plan, and the moments that explain it.

    Args:
        planner: Whose map, robot and settings the run had.
        run: The episode with its journal.
        look: Shows at each moment what the robot's camera saw.

    Returns:
        RGB image, shape (H, W, 3): the whole episode, and beside or below it the moments.
    """
    scenario, trajectory, moments = run.scenario, run.trajectory, pick_moments(run)
    panels = [_moment_panel(planner, run, moment, number, look) for number, moment in enumerate(moments, start=1)]
    view, below = _widest_view(planner.maps.robot, run, panels)
    picture = view.rgb.copy()
    draw_superseded(picture, view, run)
    draw_ways(picture, view, scenario, trajectory, run.motions, planner.robot, planner.episode_config)
    draw_changes(picture, view, run)
    draw_closest(picture, view, run)
    _put_numbers(picture, view, trajectory.xyyaw[[moment.step for moment in moments]])
    plan_view.draw_scale_bar(picture, view)
    rows = [[picture], panels] if below else [[picture, stack_panels(panels)]]
    return sheet(rows, _headline(scenario, trajectory, run), _legend(scenario, trajectory, run))


def _widest_view(robot_map: OccupancyMap, run: DrivenRun, panels: list[UInt8Array]) -> tuple[TopView, bool]:
    """The view of the episode at the largest scale, and whether the panels are below it, not beside."""
    row_px = (max(SIDE_PX[0], sum(panel.shape[1] + GAP_PX for panel in panels) - GAP_PX), BELOW_HEIGHT_PX)
    column_px = (SIDE_PX[0], max(SIDE_PX[1], sum(len(panel) + GAP_PX for panel in panels) - GAP_PX))
    below, beside = (
        episode_view(robot_map, run.scenario, run.trajectory, motions=run.motions, size_px=size_px)
        for size_px in (row_px, column_px)
    )
    gain = beside.frame.resolution_m / below.frame.resolution_m
    is_below = gain > 1 or (gain == 1 and len(panels) > 1)
    return (below if is_below else beside), is_below


def episode_view(
    robot_map: OccupancyMap,
    scenario: Scenario,
    trajectory: RobotTrajectory | None,
    *,
    motions: EpisodeMotions | None,
    size_px: tuple[int, int] | None = None,
    pixels_per_m: int = 60,
    margin_m: float = 1.0,
) -> TopView:
    """The part of the map that an episode takes place in.

    Args:
        robot_map: What blocks the robot.
        scenario: Start, goal and humans.
        trajectory: The robot's run, if there is one.
        motions: How the humans move, if that is known.
        size_px: Width and height to fill, as far as the map goes; without it the view is as small as it can be.
        pixels_per_m: Scale without `size_px` [px/m]; large places are drawn smaller.
        margin_m: Space around everything that happens [m].
    """
    points = [scenario.start_xyyaw[None, :2], scenario.goal_xy_m[None], *_ways(scenario, motions)]
    points += [] if trajectory is None else [trajectory.xyyaw[:, :2]]
    everything = np.concatenate(points)
    low_m, high_m = everything.min(axis=0) - margin_m, everything.max(axis=0) + margin_m
    pixel_m = max(1 / pixels_per_m, float((high_m - low_m).max()) / SIDE_MAX_PX)
    if size_px is not None:
        pixel_m = max(1 / SCALE_MAX_PX_PER_M, *((high_m - low_m) / np.array(size_px)).tolist())
        spare_m = np.maximum(np.array(size_px) * pixel_m - (high_m - low_m), 0.0)
        low_m, high_m = low_m - spare_m / 2, high_m + spare_m / 2
    frame, (rows, columns) = robot_map.frame, robot_map.occupied.shape
    origin_m = np.array([frame.origin_x_m, frame.origin_y_m])
    low_m = np.maximum(low_m, origin_m)
    high_m = np.minimum(high_m, origin_m + np.array([columns, rows]) * frame.resolution_m)
    return plan_view.map_window(robot_map, low_m, high_m, pixel_m=pixel_m)


def _ways(scenario: Scenario, motions: EpisodeMotions | None) -> list[Float64Array]:
    if motions is None:
        return [human.xy_m for human in scenario.humans]
    return [human.motion.root_m[:, :2].astype(np.float64) for human in motions.humans]


def draw_ways(
    picture: UInt8Array,
    view: TopView,
    scenario: Scenario,
    trajectory: RobotTrajectory | None,
    motions: EpisodeMotions | None,
    robot: RobotConfig,
    episode: EpisodeConfig,
) -> None:
    """Goal, humans and robot with their ways on a view from `episode_view`, all as they are when the run ends."""
    end, rate_hz = (None, RATE_HZ) if trajectory is None else (len(trajectory.xyyaw) - 1, trajectory.rate_hz)
    plan_view.draw_ring(picture, view, scenario.goal_xy_m, episode.success_radius_m, GOAL)
    plan_view.draw_goal(picture, view, scenario.goal_xy_m, radius_m=0.12)
    for k, way in enumerate(_ways(scenario, motions)):
        draw_way(picture, view, way, human_colour(k), end=end, rate_hz=rate_hz)
        place = way[0 if end is None else min(end, len(way) - 1)]
        plan_view.draw_disc(picture, view, place, episode.human_radius_m, human_colour(k))
        plan_view.draw_arrow_head(picture, view, way, human_colour(k))
    if trajectory is None:
        plan_view.draw_robot(picture, view, scenario.start_xyyaw, robot.radius_m)
        return
    draw_way(picture, view, trajectory.xyyaw[:, :2], ROBOT, end=end, rate_hz=rate_hz)
    plan_view.draw_ring(picture, view, scenario.start_xyyaw[:2], robot.radius_m, ROBOT)
    plan_view.draw_disc(picture, view, trajectory.xyyaw[-1, :2], robot.radius_m, OUTCOMES[trajectory.outcome])


def _put_numbers(picture: UInt8Array, view: TopView, poses: Float64Array) -> None:
    """Numbers to the right of the robot's poses, where they hide neither its way nor each other."""
    placed: list[Float64Array] = []
    for number, (x, y, yaw) in enumerate(poses.tolist(), start=1):
        right = np.array([np.sin(yaw), -np.cos(yaw)])
        place = np.array([x, y]) + 0.35 * right
        while any(np.hypot(*(place - other)) < NUMBER_APART_PX * view.frame.resolution_m for other in placed):
            place = place + 0.1 * right
        placed.append(place)
        plan_view.put_mark(picture, view, place, str(number), INK)


def _moment_panel(
    planner: RobotPlanner, run: DrivenRun, moment: RunMoment, number: int, look: Look | None
) -> UInt8Array:
    """The robot's surroundings at one moment, with what the expert knew and what the camera showed."""
    pose = run.trajectory.xyyaw[moment.step]
    centre_m = pose[:2] + AHEAD_M * np.array([np.cos(pose[2]), np.sin(pose[2])])
    half = np.full(2, MOMENT_M / 2)
    view = plan_view.map_window(planner.maps.robot, centre_m - half, centre_m + half, pixel_m=MOMENT_M / MOMENT_PX)
    picture = view.rgb.copy()
    draw_knowledge(picture, view, planner, run, moment.step)
    plan_view.draw_goal(picture, view, run.scenario.goal_xy_m, radius_m=0.12)
    known = {who.index for who in run.journal.perceived[moment.step]}
    for k in range(len(run.scenario.humans)):
        here, radius_m = run.human_xy_m(k)[moment.step], planner.episode_config.human_radius_m
        draw = plan_view.draw_disc if k in known else plan_view.draw_ring
        draw(picture, view, here, radius_m, human_colour(k))
    plan_view.draw_robot(picture, view, pose, planner.robot.radius_m)
    bar = np.full((24, MOMENT_PX, 3), 255, np.uint8)
    cv2.circle(bar, (10, 12), 9, INK, cv2.FILLED, cv2.LINE_AA)
    plan_view.put_text(bar, str(number), (6, 17), colour=WHITE)
    plan_view.put_text(bar, f"{moment.step * run.trajectory.dt_s:.2f} s  {moment.why}", (26, 17))
    return np.concatenate([bar, *([] if look is None else [_scale_image(look(moment.step), MOMENT_PX)]), picture])


def _scale_image(image: UInt8Array, width_px: int) -> UInt8Array:
    size = (width_px, round(image.shape[0] * width_px / image.shape[1]))
    method = cv2.INTER_AREA if image.shape[1] > width_px else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, size, interpolation=method), dtype=np.uint8)


def _headline(scenario: Scenario, trajectory: RobotTrajectory | None, run: DrivenRun | None) -> list[tuple[str, Rgb]]:
    """Words of the headline with their colours."""
    if trajectory is None:
        return [("not driven", INK), (scenario.episode.episode_id, INK)]
    words = [(trajectory.outcome.value.replace("_", " "), OUTCOMES[trajectory.outcome])]
    words.append((f"{trajectory.duration_s:.1f} s", INK))
    closest_m = float(trajectory.human_distance_m.min(initial=np.inf))
    if np.isfinite(closest_m):
        words.append((f"closest {closest_m:.2f} m", INK))
    if run is not None and not run.explained:
        words.append((f"{run.driver} drives", INK))
    elif run is not None:
        searches, changes = sum(run.journal.searched), len(run.journal.changes)
        words.append((f"{searches} replans, {changes} paths", INK))
    return [*words, (scenario.episode.episode_id, INK)]


def _legend(scenario: Scenario, trajectory: RobotTrajectory | None, run: DrivenRun | None) -> list[tuple[Swatch, str]]:
    items: list[tuple[Swatch, str]] = [(dotted_swatch(ROBOT), "robot, a dot a second")] if trajectory else []
    for k, human in enumerate(scenario.humans):
        items.append((dotted_swatch(human_colour(k)), f"pedestrian {k + 1}: {human.avatar}, {human.encounter}"))
    if run is not None and not run.explained:
        items.append((line_swatch(ADVICE), "what the expert would do"))
    elif run is not None:
        items.append((lambda picture, x, y: put_diamond(picture, (x, y)), "chose another path"))
        items += [(line_swatch(SUPERSEDED), "abandoned path")] if run.journal.given_up else []
    if run is not None:
        items.append((area_swatch(SIGHT, SIGHT_SHARE), "field of view"))
    if run is not None and scenario.humans:
        items.append((area_swatch(human_colour(0), EXPECTED_SHARE), "expected there"))
        items.append((ring_swatch(human_colour(0), filled=False), "not perceived"))
    return [*items, (ring_swatch(GOAL), "goal")]
