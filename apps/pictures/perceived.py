"""What a network perceives along a driven episode, drawn on the robot's images and on the map."""

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.camera.config import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.common.drawing import plan_view
from readygo.common.drawing.plan_view import WHITE, Rgb
from readygo.common.drawing.sheet import Swatch, ring_swatch
from readygo.common.maps import FloorMap
from readygo.common.messages import EpisodeKey, RobotTrajectory
from readygo.common.messages.live import LivePerception, LivePerson
from readygo.common.perception import live_perception
from readygo.common.perception.episode import EpisodePerception
from readygo.common.perception.live import covariance_ellipse, free_points, place_ahead
from readygo.common.robot import RobotConfig
from readygo.common.scenes.top_view import TopView
from readygo.services.planner import TrackedHumans

PERCEIVED: Rgb = (200, 0, 110)
"""Colour of perceived people."""
FREE: Rgb = (0, 140, 150)
"""Colour of free distances on the map."""
HUMAN_HEIGHT_M, HUMAN_HALF_WIDTH_M = 1.7, 0.25
"""Size of the mark of a human [m]."""
STANDING_MPS = 0.15
"""Slower people have no arrow [m/s]."""
FAR_M = 5.0
"""Free distance from which the strip is green [m]."""
STRIP_SHARE = 0.022
"""Height of the strip of free distances, as a share of the image's."""
_NEAR_M = 0.05
_FRESH_S = 0.15
"""Tracks that were detected longer ago are drawn thin [s]."""


class PerceivedRun:
    """What a network perceives in the images of a driven episode, as its driver did."""

    def __init__(
        self,
        perception: EpisodePerception[TrackedHumans],
        episode: EpisodeKey,
        trajectory: RobotTrajectory,
        robot: RobotConfig,
        floor: FloorMap,
        image_at: Callable[[int], UInt8Array],
    ) -> None:
        """Prepare; images are looked at as steps are asked for.

        Args:
            perception: At the episode's begin.
            episode: The episode.
            trajectory: What the robot did.
            robot: Robot of the episode.
            floor: Height of the floor.
            image_at: The first camera's image at a step, sRGB, shape (H, W, 3).
        """
        self._perception, self._episode, self._trajectory = perception, episode, trajectory
        self._robot, self._floor, self._image_at = robot, floor, image_at
        self._looks: list[LivePerception] = []

    @property
    def camera(self) -> CameraConfig:
        """The camera whose images are looked at."""
        return self._robot.camera

    def at(self, step: int) -> LivePerception:
        """What is perceived at a step, from the newest look."""
        for each in range(len(self._looks), step + 1):
            self._looks.append(self._perceive(each))
        return self._looks[step]

    def _perceive(self, step: int) -> LivePerception:
        perception, clock, rows = self._perception, self._robot.clock, self._trajectory.xyyaw
        v, w = self._trajectory.actions[step - 1].tolist() if step else (0.0, 0.0)
        perception.advance((v, w))
        if perception.arrives(step) and perception.is_due(step):
            taken = perception.taken_at(step)
            x, y, yaw = rows[taken].tolist()
            perception.look(step, self._image_at(taken), (v, w), (x, y, yaw))
        x, y, yaw = rows[step].tolist()
        perception.people.observe(step, (x, y, yaw), np.empty((0, 2)))
        assert perception.perceived is not None
        x, y, yaw = perception.pose
        pose = (x, y, self._floor.at(x, y), yaw)
        tracks = perception.people.tracker.known
        return live_perception(
            self._episode, clock.time_ns(step), pose, perception.perceived, tracks, self._robot.camera
        )


def draw_on_image(picture: UInt8Array, perception: LivePerception, camera: CameraConfig) -> None:
    """Mark people and free distances on an image.

    Args:
        picture: The image, or an enlarged one; drawn on, shape (H, W, 3).
        perception: What was perceived in it.
        camera: The camera.
    """
    x, y, z, yaw = perception.robot_xyzyaw
    T_world_camera = camera.T_world_camera(x, y, yaw, z)
    scale = picture.shape[1] / camera.width_px
    floor = free_points(perception, camera)
    dots = _to_pixels(np.column_stack([floor, np.full(len(floor), z)]), T_world_camera, camera, scale)
    for dot in dots[np.isfinite(dots).all(axis=1)].tolist():
        centre = round(dot[0]), round(dot[1])
        cv2.circle(picture, centre, 3, WHITE, cv2.FILLED, cv2.LINE_AA)
        cv2.circle(picture, centre, 2, FREE, cv2.FILLED, cv2.LINE_AA)
    _draw_strip(picture, perception.rays_m)
    eye = T_world_camera[:2, 3]
    for person in sorted(perception.detections, key=lambda person: -math.dist(person.xy_m, eye)):
        _draw_person(picture, person, T_world_camera, camera, scale, z)
    for person in perception.tracks:
        if person.age_s < _FRESH_S and math.hypot(*person.v_mps) > STANDING_MPS:
            _draw_arrow(picture, person, T_world_camera, camera, scale, z)


def draw_on_map(picture: UInt8Array, view: TopView, perception: LivePerception, camera: CameraConfig) -> None:
    """Draw free distances, and tracks with their velocities and covariances on a map.

    Args:
        picture: The map; drawn on.
        view: Where the picture lies.
        perception: What is perceived.
        camera: The robot's camera.
    """
    plan_view.draw_path(picture, view, free_points(perception, camera), FREE, width_px=1)
    for person in perception.tracks:
        width = 2 if person.age_s < _FRESH_S else 1
        outline = covariance_ellipse(person)
        plan_view.draw_path(picture, view, outline, WHITE, width_px=width + 2)
        plan_view.draw_path(picture, view, outline, PERCEIVED, width_px=width)
        if math.hypot(*person.v_mps) > STANDING_MPS:
            begin, end = (_rounded(view.world_to_pixel(np.array(xy_m))) for xy_m in (person.xy_m, place_ahead(person)))
            _draw_arrow_px(picture, begin, end, width, tip_px=7)


def legend() -> Sequence[tuple[Swatch, str]]:
    """The meaning of the marks on image and map."""
    return (
        (_bracket_swatch, "perceived human, distance"),
        (_arrow_swatch, "velocity of its track, 1 s"),
        (ring_swatch(PERCEIVED, filled=False), "track, 2 standard deviations"),
        (_dot_swatch, "free distance"),
        (_strip_swatch, f"0 to {FAR_M:g} m free"),
    )


def _draw_person(
    picture: UInt8Array,
    person: LivePerson,
    T_world_camera: Float64Array,
    camera: CameraConfig,
    scale: float,
    floor_m: float,
) -> None:
    place, eye = np.array(person.xy_m), T_world_camera[:2, 3]
    distance_m = float(np.hypot(*(place - eye)))
    across = np.array([-(place - eye)[1], (place - eye)[0]]) / max(distance_m, _NEAR_M)
    left, right = place + HUMAN_HALF_WIDTH_M * across, place - HUMAN_HALF_WIDTH_M * across
    top_m = floor_m + HUMAN_HEIGHT_M
    corners = np.array([(*left, floor_m), (*right, floor_m), (*right, top_m), (*left, top_m)])
    box = _to_pixels(corners, T_world_camera, camera, scale)
    if not np.isfinite(box).all():
        return
    _draw_brackets(picture, box)
    text = f"{distance_m:.1f} m"
    height, width = picture.shape[:2]
    u = round(float(np.clip(box[:, 0].mean() - plan_view.text_width_px(text, size=0.55) / 2, 2, width - 60)))
    v = round(float(np.clip(box[:, 1].min() - 6, 18, height - 20)))
    plan_view.put_text(picture, text, (u, v), size=0.55, colour=PERCEIVED, halo=WHITE)


def _draw_brackets(picture: UInt8Array, box: Float64Array) -> None:
    """The corners of a box of four pixels."""
    for width, colour in ((4, WHITE), (2, PERCEIVED)):
        for k in range(4):
            corner, before, after = box[k], box[k - 1], box[(k + 1) % 4]
            for other in (before, after):
                end = corner + 0.28 * (other - corner)
                cv2.line(picture, _rounded(corner), _rounded(end), colour, width, cv2.LINE_AA)


def _draw_arrow(
    picture: UInt8Array,
    person: LivePerson,
    T_world_camera: Float64Array,
    camera: CameraConfig,
    scale: float,
    floor_m: float,
) -> None:
    """The velocity on the floor."""
    ends = _to_pixels(
        np.array([(*person.xy_m, floor_m), (*place_ahead(person), floor_m)]), T_world_camera, camera, scale
    )
    if np.isfinite(ends).all():
        _draw_arrow_px(picture, _rounded(ends[0]), _rounded(ends[1]), 3, tip_px=16)


def _draw_arrow_px(
    picture: UInt8Array, begin: tuple[int, int], end: tuple[int, int], width: int, *, tip_px: float
) -> None:
    tip = min(0.5, tip_px / max(math.dist(begin, end), 1.0))
    for line, colour in ((width + 2, WHITE), (width, PERCEIVED)):
        cv2.arrowedLine(picture, begin, end, colour, line, cv2.LINE_AA, tipLength=tip)


def _draw_strip(picture: UInt8Array, rays_m: Float32Array) -> None:
    """Free distances along the bottom of an image, a column each."""
    height, width = picture.shape[:2]
    top = height - max(3, round(STRIP_SHARE * height))
    edges = np.rint(np.linspace(0, width, len(rays_m) + 1)).astype(int).tolist()
    for k, ray_m in enumerate(rays_m.tolist()):
        picture[top:, edges[k] : edges[k + 1]] = free_colour(ray_m)
    picture[top - 1, :] = WHITE


def free_colour(distance_m: float) -> Rgb:
    """Colour of a free distance: red where there is none, over yellow, to green from `FAR_M` on."""
    share = min(max(distance_m / FAR_M, 0.0), 1.0)
    low, high, part = (
        ((200, 30, 30), (240, 214, 60), 2 * share) if share < 0.5 else ((240, 214, 60), (0, 158, 115), 2 * share - 1)
    )
    red, green, blue = (round(a + part * (b - a)) for a, b in zip(low, high, strict=True))
    return red, green, blue


def _to_pixels(p_WQ: Float64Array, T_world_camera: Float64Array, camera: CameraConfig, scale: float) -> Float64Array:
    """Pixels of world points in an enlarged image, nan for points that are not ahead, shape (N, 3) -> (N, 2)."""
    p_CQ = (p_WQ - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    pixels = np.full((len(p_CQ), 2), np.nan)
    ahead = p_CQ[:, 2] > _NEAR_M
    if ahead.any():
        pixels[ahead] = scale * make_lens(camera).pixels(p_CQ[ahead, :2] / p_CQ[ahead, 2:])
    return pixels


def _rounded(pixel: Float64Array) -> tuple[int, int]:
    u, v = np.rint(np.clip(pixel - 0.5, -9000, 9000)).astype(int).tolist()
    return u, v


def _bracket_swatch(picture: UInt8Array, x: int, y: int) -> None:
    _draw_brackets(picture, np.array([(x - 6.0, y + 9.0), (x + 6.0, y + 9.0), (x + 6.0, y - 8.0), (x - 6.0, y - 8.0)]))


def _arrow_swatch(picture: UInt8Array, x: int, y: int) -> None:
    cv2.arrowedLine(picture, (x - 11, y), (x + 11, y), PERCEIVED, 2, cv2.LINE_AA, tipLength=0.35)


def _dot_swatch(picture: UInt8Array, x: int, y: int) -> None:
    for at in (x - 7, x, x + 7):
        cv2.circle(picture, (at, y), 2, FREE, cv2.FILLED, cv2.LINE_AA)


def _strip_swatch(picture: UInt8Array, x: int, y: int) -> None:
    for k in range(20):
        picture[y - 4 : y + 5, x - 10 + k] = free_colour(FAR_M * k / 19)
