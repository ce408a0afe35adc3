"""What a picture of an episode is put together from, each on a view from above."""

import cv2
import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.camera.view import FieldOfView, view_of
from readygo.common.drawing import plan_view
from readygo.common.drawing.plan_view import GOAL, HUMANS, INK, ROBOT, WHITE, Rgb
from readygo.common.messages import Outcome
from readygo.common.robot.kinematics import RATE_HZ
from readygo.common.scenes.top_view import TopView
from readygo.services.planner.expert.handlers import RobotPlanner
from readygo.services.planner.explain.journal import DrivenRun
from readygo.services.planner.explain.wedge import wedge_m

SIGHT: Rgb = (240, 214, 60)
SUPERSEDED: Rgb = (142, 186, 218)
ADVICE: Rgb = (110, 60, 160)
"""Colour of the expert's plan where another driver drives."""
OUTCOMES: dict[Outcome, Rgb] = {
    Outcome.SUCCESS: GOAL,
    Outcome.STATIC_COLLISION: (200, 30, 30),
    Outcome.HUMAN_COLLISION: (200, 30, 30),
    Outcome.TIMEOUT: (200, 120, 0),
}
SIGHT_SHARE, EXPECTED_SHARE = 0.35, 0.4
EXPECTED_S = 2.0
"""Pictures show where humans are expected for this long [s], regardless of how far ahead the mode looks."""
DIAMOND_APART_PX = 12


def human_colour(human: int) -> Rgb:
    """Colour of a human in all pictures of an episode."""
    return HUMANS[human % len(HUMANS)]


def draw_way(
    picture: UInt8Array, view: TopView, xy_m: Float64Array, colour: Rgb, *, end: int | None, rate_hz: int = RATE_HZ
) -> None:
    """A way: thin as a whole, thick with a dot at every second up to step `end`."""
    plan_view.draw_path(picture, view, xy_m, colour, width_px=1)
    if end is None:
        return
    plan_view.draw_path(picture, view, xy_m[: end + 1], colour, width_px=3)
    for point in xy_m[: end + 1 : rate_hz]:
        u, v = (round(float(value)) for value in view.world_to_pixel(point) - 0.5)
        cv2.circle(picture, (u, v), 4, colour, cv2.FILLED, cv2.LINE_AA)


def draw_superseded(picture: UInt8Array, view: TopView, run: DrivenRun, steps: range | None = None) -> None:
    """The driver's plans that another one replaced, at any time or at some steps, as they were then."""
    if not run.explained:
        return
    for step in run.journal.given_up:
        if steps is None or step in steps:
            plan_view.draw_path(picture, view, run.journal.paths_m[step - 1], SUPERSEDED, width_px=1)


def draw_changes(picture: UInt8Array, view: TopView, run: DrivenRun) -> None:
    """A diamond where the robot was when its driver chose another way; of close ones only the first."""
    if not run.explained:
        return
    last = np.full(2, np.inf)
    for step in run.journal.changes:
        place = view.world_to_pixel(run.trajectory.xyyaw[step, :2]) - 0.5
        if float(np.hypot(*(place - last))) >= DIAMOND_APART_PX or step == run.journal.changes[0]:
            put_diamond(picture, (round(float(place[0])), round(float(place[1]))))
            last = place


def put_diamond(picture: UInt8Array, centre_px: tuple[int, int]) -> None:
    """The mark of a replan."""
    u, v = centre_px
    corners = np.array([[u - 6, v], [u, v - 6], [u + 6, v], [u, v + 6]], dtype=np.int32)
    cv2.fillPoly(picture, [corners], WHITE, cv2.LINE_AA)
    cv2.polylines(picture, [corners], True, ROBOT, 2, cv2.LINE_AA)


def draw_knowledge(picture: UInt8Array, view: TopView, planner: RobotPlanner, run: DrivenRun, step: int) -> None:
    """What the expert sees, expects and intends at a step: field of view, where humans will be, plan."""
    _draw_sight(picture, view, planner, run.trajectory.xyyaw[step])
    radius_m = planner.episode_config.human_radius_m
    for who in run.journal.perceived[step]:
        ahead_m = np.concatenate([[(who.x_m, who.y_m)], who.ahead_m[: planner.robot.clock.steps(EXPECTED_S)]])
        share = EXPECTED_SHARE if who.seen else EXPECTED_SHARE / 2
        plan_view.fill_band(picture, view, ahead_m, radius_m, human_colour(who.index), share=share)
    plan_view.draw_path(picture, view, run.journal.paths_m[step], ROBOT if run.explained else ADVICE, width_px=1)


def _draw_sight(picture: UInt8Array, view: TopView, planner: RobotPlanner, pose: Float64Array) -> None:
    """Where the expert sees humans, and the outline of its fields of view and of what it feels nearby."""
    ground = planner.ground
    for camera in planner.robot.all_cameras.values():
        _draw_field(picture, view, planner, np.array(camera.eye(*pose.tolist())), view_of(camera))
    if ground.config.near_field_m > 0:
        plan_view.draw_ring(picture, view, pose[:2], ground.config.near_field_m, SIGHT)


def _draw_field(
    picture: UInt8Array, view: TopView, planner: RobotPlanner, eye: Float64Array, shown: FieldOfView
) -> None:
    """Draw what one camera sees."""
    ground, range_m = planner.ground, planner.ground.config.range_m

    def sees(to_x: float, to_y: float) -> bool:
        return ground.sight.sees(float(eye[0]), float(eye[1]), shown.height_m, (to_x, to_y))

    borders_rad = (-shown.right_rad, shown.left_rad)
    seen = wedge_m(eye, borders_rad, range_m, sees=sees if ground.config.needs_line_of_sight else None)
    plan_view.fill_area(picture, view, seen, SIGHT, share=SIGHT_SHARE)
    whole = wedge_m(eye, borders_rad, range_m)
    plan_view.draw_path(picture, view, np.concatenate([whole, whole[:1]]), SIGHT, width_px=1)


def draw_closest(picture: UInt8Array, view: TopView, run: DrivenRun) -> None:
    """A line between the robot and the nearest human when they were closest, with its length."""
    gaps = [run.gap_m(k) for k in range(len(run.scenario.humans))]
    if not gaps:
        return
    nearest = min(range(len(gaps)), key=lambda k: float(gaps[k].min()))
    step = int(np.argmin(gaps[nearest]))
    ends = np.stack([run.trajectory.xyyaw[step, :2], run.human_xy_m(nearest)[step]])
    plan_view.draw_path(picture, view, ends, WHITE, width_px=4)
    plan_view.draw_path(picture, view, ends, INK, width_px=1)
    text = f"{float(gaps[nearest][step]):.2f} m"
    u, v = view.world_to_pixel(ends.mean(axis=0)).tolist()
    put_label(picture, text, (round(u) + 10, round(v) + 4))


def put_label(picture: UInt8Array, text: str, xy_px: tuple[int, int]) -> None:
    """Text on a white ground that keeps within the picture."""
    width = plan_view.text_width_px(text, size=0.4) + 6
    x = min(max(xy_px[0], 0), picture.shape[1] - width)
    y = min(max(xy_px[1], 14), picture.shape[0] - 4)
    cv2.rectangle(picture, (x, y - 12), (x + width, y + 4), WHITE, cv2.FILLED)
    plan_view.put_text(picture, text, (x + 3, y), size=0.4)
