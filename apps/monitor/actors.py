"""An episode in a browser's scene: robot, camera views, humans, paths, goal and replans."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from readygo.apps.monitor import shapes
from readygo.apps.monitor.shapes import ViewerMesh
from readygo.apps.monitor.track import on_floor
from readygo.apps.pictures.perceived import FREE, PERCEIVED
from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.camera.config import CameraConfig
from readygo.common.drawing.plan_view import GOAL, HUMANS
from readygo.common.frames import quat_from_matrix
from readygo.common.messages.live import LivePerception, LiveState
from readygo.common.perception.live import covariance_ellipse, free_points, place_ahead
from readygo.common.robot import RobotConfig

Rgb = tuple[int, int, int]
BODY: Rgb = (240, 243, 247)
ACCENTS: tuple[Rgb, ...] = ((41, 161, 255), (255, 174, 52), (120, 220, 120), (214, 120, 255))
"""Colours of the workers, in turn."""
REPLAN: Rgb = (255, 214, 64)
SIGHT_M = 3.0
"""Drawn length of the field of view [m]."""
LIFT_M = 0.1
"""Height of drawings above the floor, whose Gaussians would hide them [m]."""
TRAIL_STEP_M = 0.05
HUMANS_MAX = 8
_ON_ROBOT = ("body", "label", "view", "fan")
"""Prefixes of the names of nodes that move with the robot."""


class Actor:
    """Scene nodes of one episode below a name; `show` moves them."""

    def __init__(self, scene: Any, name: str, robot: RobotConfig, accent: Rgb) -> None:
        """Prepare an episode without nodes.

        Args:
            scene: A viser scene.
            name: Parent of the nodes, such as "/robots/0".
            robot: Robot, with its size and cameras.
            accent: Colour of the robot's nodes.
        """
        self._scene, self._name, self._robot, self._accent = scene, name, robot, accent
        self._nodes: dict[str, Any] = {}
        self._humans: list[Any] = []
        self._fov_rad = 0.0
        self._trail: list[tuple[float, float, float]] = []
        self._planned: object = None
        self._perceived: LivePerception | None = None
        self.eyes = False
        """True hides the robot's body: the viewer looks through its camera."""

    def show(self, state: LiveState, label: str, *, trail: bool = True) -> None:
        """Move robot and humans to their poses."""
        x, y, z, yaw = state.robot_xyzyaw
        base = self._node("robot", self._make_robot)
        base.position, base.wxyz = (x, y, z), _yaw_wxyz(yaw)
        if abs(state.horizontal_fov_rad - self._fov_rad) > 1e-3:
            self._see(state.horizontal_fov_rad)
        self._nodes["body"].visible = not self.eyes
        tag = self._nodes["label"]
        if tag.text != label:
            tag.text = label
        tag.visible = not self.eyes
        self._aim(state)
        self._place_humans(state)
        if trail:
            self._leave_trail((x, y, z))

    def plan(
        self, way: Float64Array, replans: Float64Array, humans: tuple[Float64Array, ...] = (), *, of: object
    ) -> None:
        """Draw the paths of robot and humans.

        Args:
            way: Path of the robot [m], shape (N, 3).
            replans: Positions of the replans [m], shape (R, 3).
            humans: Paths of the humans [m], shape (N, 3) each.
            of: Owner of the paths; they are drawn again only if it differs from the last call's.
        """
        if self._planned == of:
            return
        self._planned = of
        self._trail.clear()
        self._drop("trail")
        self._line("way", way, self._accent, 0.035, 0.75)
        for number in range(HUMANS_MAX):
            shown = humans[number] if number < len(humans) else np.zeros((0, 3))
            self._line(f"way{number}", shown, HUMANS[number % len(HUMANS)], 0.022, 0.8)
        self._mark(replans)

    def perceive(self, perception: LivePerception | None) -> None:
        """Draw what the driver perceives: tracks with velocities and covariances, and the free space; None for none."""
        if perception is self._perceived:
            return
        self._perceived = perception
        if perception is None:
            for name in ("tracks", "free"):
                self._drop(name)
            return
        floor_m = perception.robot_xyzyaw[2]
        self._segments("tracks", track_segments(perception), PERCEIVED, 0.03)
        free = on_floor(free_points(perception, self._robot.camera).astype(np.float32), floor_m)
        self._segments("free", shapes.segments(free, LIFT_M), FREE, 0.02)

    def picture(self, camera: str, rgb: UInt8Array | None) -> None:
        """Show the newest image in front of a camera; the first one is called ""."""
        if f"view{camera}" in self._nodes and rgb is not None:
            self._nodes[f"view{camera}"].image = rgb

    def hide(self) -> None:
        """Remove all nodes."""
        for name in list(self._nodes):
            if name.startswith(_ON_ROBOT):
                # Removing the parent removes them as well.
                del self._nodes[name]
            else:
                self._drop(name)
        while self._humans:
            self._humans.pop().remove()
        self._fov_rad, self._planned, self._perceived = 0.0, None, None
        self._trail.clear()

    def _node(self, name: str, make: Callable[[], Any]) -> Any:
        if name not in self._nodes:
            self._nodes[name] = make()
        return self._nodes[name]

    def _drop(self, name: str) -> None:
        if name in self._nodes:
            self._nodes.pop(name).remove()

    def _mesh(self, path: str, mesh: ViewerMesh, colour: Rgb, opacity: float | None = None, **more: Any) -> Any:
        return self._scene.add_mesh_simple(
            f"{self._name}/{path}", mesh.vertices_m, mesh.faces, color=colour, opacity=opacity, side="double", **more
        )

    def _make_robot(self) -> Any:
        robot = self._robot
        base = self._scene.add_frame(f"{self._name}/robot", show_axes=False)
        self._nodes["body"] = self._scene.add_frame(f"{self._name}/robot/body", show_axes=False)
        self._mesh("robot/body/drum", shapes.robot(robot.radius_m, robot.height_m), BODY)
        height_m = robot.height_m
        self._mesh("robot/body/band", shapes.band(robot.radius_m, 0.62 * height_m, 0.72 * height_m), self._accent)
        nose = shapes.move_mesh(shapes.gem(0.05), robot.radius_m, 0.0, robot.camera.mount_height_m - 0.06)
        self._mesh("robot/body/nose", nose, (30, 34, 40))
        glow = shapes.disc(robot.radius_m + 0.10, robot.radius_m + 0.05)
        self._mesh("robot/glow", shapes.move_mesh(glow, 0.0, 0.0, LIFT_M), self._accent, 0.9, cast_shadow=False)
        self._nodes["label"] = self._scene.add_label(
            f"{self._name}/robot/label", "", position=(0.0, 0.0, height_m + 0.45), anchor="bottom-center"
        )
        return base

    def _see(self, fov_rad: float) -> None:
        """Draw the fields of view; the episode states the first camera's."""
        self._fov_rad = fov_rad
        self._see_with("", self._robot.camera, fov_rad)
        for name, camera in self._robot.cameras.items():
            self._see_with(name, camera, 2 * math.atan(camera.width_px / (2 * float(camera.K_px[0, 0]))))

    def _see_with(self, name: str, camera: CameraConfig, fov_rad: float) -> None:
        """Draw a camera's field of view; it fades with distance."""
        angle_rad = min(fov_rad, math.radians(179.0))
        T_robot_camera = camera.T_world_camera(0.0, 0.0, 0.0, 0.0)
        ahead = _yaw_wxyz(math.radians(camera.mount_yaw_deg))
        for number, (begin, end, opacity) in enumerate(((0.15, 0.45, 0.5), (0.45, 0.75, 0.34), (0.75, 1.0, 0.2))):
            ring = shapes.move_mesh(shapes.fan(angle_rad, end * SIGHT_M, begin * SIGHT_M), 0.0, 0.0, LIFT_M)
            self._nodes[f"fan{name}{number}"] = self._mesh(
                f"robot/fan{name}{number}", ring, self._accent, opacity, cast_shadow=False, wxyz=ahead
            )
        aspect = camera.width_px / camera.height_px
        self._nodes[f"view{name}"] = self._scene.add_camera_frustum(
            f"{self._name}/robot/body/view{name}",
            fov=2 * math.atan(math.tan(angle_rad / 2) / aspect),
            aspect=aspect,
            scale=0.22,
            color=self._accent,
            thickness=0.006,
            wxyz=quat_from_matrix(T_robot_camera[:3, :3]),
            position=T_robot_camera[:3, 3],
            cast_shadow=False,
        )

    def _aim(self, state: LiveState) -> None:
        """Show the goal."""
        goal = self._node("goal", self._make_goal)
        goal.position = (*state.goal_xy_m, state.robot_xyzyaw[2] + LIFT_M)

    def _make_goal(self) -> Any:
        goal = self._scene.add_frame(f"{self._name}/goal", show_axes=False)
        parts = [shapes.disc(0.34, 0.27), shapes.disc(0.18, 0.12), shapes.pin(0.8)]
        self._mesh("goal/mark", shapes.join_meshes(parts), GOAL, 0.95)
        return goal

    def _place_humans(self, state: LiveState) -> None:
        humans = state.humans_xyzyaw[:HUMANS_MAX]
        while len(self._humans) > len(humans):
            self._humans.pop().remove()
        while len(self._humans) < len(humans):
            self._humans.append(self._make_human(len(self._humans)))
        for node, (x, y, z, yaw) in zip(self._humans, humans, strict=True):
            node.position, node.wxyz = (x, y, z), _yaw_wxyz(yaw)

    def _make_human(self, number: int) -> Any:
        colour = HUMANS[number % len(HUMANS)]
        path = f"human{number}"
        base = self._scene.add_frame(f"{self._name}/{path}", show_axes=False)
        self._mesh(f"{path}/body", shapes.human(), colour)
        ahead = shapes.move_mesh(shapes.fan(0.9, 0.52, 0.34), 0.0, 0.0, LIFT_M)
        self._mesh(f"{path}/ahead", ahead, colour, 0.85, cast_shadow=False)
        return base

    def _leave_trail(self, place: tuple[float, float, float]) -> None:
        if self._trail and math.dist(self._trail[-1], place) > 1.5:
            self._trail.clear()
        if not self._trail or math.dist(self._trail[-1], place) > TRAIL_STEP_M:
            self._trail.append(place)
            del self._trail[:-400]
            self._line("trail", np.array(self._trail), self._accent, 0.05, 1.0)

    def _line(self, name: str, way: Float64Array, colour: Rgb, thickness_m: float, strength: float) -> None:
        """Draw a path as a line; a lower strength is darker."""
        points = shapes.segments(way, LIFT_M + 0.02) if len(way) else way
        if not len(points):
            self._drop(name)
            return
        if name in self._nodes:
            self._nodes[name].points = points
            return
        shade = tuple(round(strength * value) for value in colour)
        self._nodes[name] = self._scene.add_line_segments(f"{self._name}/{name}", points, shade, thickness=thickness_m)

    def _segments(self, name: str, points: Float32Array, colour: Rgb, thickness_m: float) -> None:
        """Draw separate lines, shape (N, 2, 3)."""
        if not len(points):
            self._drop(name)
        elif name in self._nodes:
            self._nodes[name].points = points
        else:
            self._nodes[name] = self._scene.add_line_segments(
                f"{self._name}/{name}", points, colour, thickness=thickness_m
            )

    def _mark(self, places: Float64Array) -> None:
        self._drop("replans")
        if len(places):
            gems = [
                shapes.move_mesh(shapes.gem(0.035), *place) for place in (places + np.array([0.0, 0.0, 0.1])).tolist()
            ]
            self._nodes["replans"] = self._mesh("replans", shapes.join_meshes(gems), REPLAN)


def eye_of(camera: CameraConfig, state: LiveState) -> Float64Array:
    """Pose of the robot's camera, T_world_camera, shape (4, 4)."""
    x, y, z, yaw = state.robot_xyzyaw
    return camera.T_world_camera(x, y, yaw, z)


def track_segments(perception: LivePerception) -> Float32Array:
    """Covariance ellipses and arrows of velocities of tracks, on the floor [m], shape (N, 2, 3)."""
    height_m = perception.robot_xyzyaw[2]
    parts = [np.zeros((0, 2, 3), np.float32)]
    for person in perception.tracks:
        parts.append(shapes.segments(on_floor(covariance_ellipse(person).astype(np.float32), height_m), LIFT_M))
        parts.append(shapes.arrow_segments(person.xy_m, place_ahead(person), height_m + LIFT_M))
    return np.concatenate(parts)


def _yaw_wxyz(yaw_rad: float) -> tuple[float, float, float, float]:
    return math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)
