"""Rerun, live: robot, camera, humans, paths and numbers as its archetypes; the only module that imports its SDK."""

import math
from typing import Any

import numpy as np

from readygo.apps.monitor.feed import LiveMoment
from readygo.apps.monitor.splats import DollsHouse
from readygo.apps.pictures.perceived import FREE, HUMAN_HALF_WIDTH_M, HUMAN_HEIGHT_M, PERCEIVED
from readygo.common.arrays import Float64Array
from readygo.common.dataset.markers import BODY_HEIGHT_M, BODY_RADIUS_M
from readygo.common.dataset.schemas import camera_frame
from readygo.common.drawing.plan_view import GOAL, HUMANS, ROBOT
from readygo.common.errors import RunError
from readygo.common.extras import install_command
from readygo.common.frames import quat_from_matrix
from readygo.common.images.names import RGB, camera_of, kind_of
from readygo.common.messages.live import LivePerception
from readygo.common.perception.live import AHEAD_S, LIFT_M, covariance_ellipse, free_points
from readygo.common.robot import RobotConfig

SPAWN = "spawn"
"""Value of `where` that starts a viewer on this machine."""
POINT_M = 0.015


class RerunSink:
    """A recording that a viewer shows while it grows, or a file."""

    def __init__(self, robot: RobotConfig, house: DollsHouse | None, where: str) -> None:
        """Open the recording.

        Args:
            robot: Robot, with its size and cameras.
            house: The scene; None without one.
            where: `SPAWN`, the viewer's address such as rerun+http://127.0.0.1:9876/proxy, or a file, .rrd.

        Raises:
            RunError: If the SDK is not installed, or there is no such viewer.
        """
        try:
            import rerun
        except ImportError as error:
            raise RunError(f"--rerun needs rerun-sdk; install it with: {install_command('rerun')}") from error
        self._rr, self._robot = rerun, robot
        self._stream: Any = rerun.RecordingStream("readygo")
        try:
            if where == SPAWN:
                self._stream.spawn()
            elif where.endswith(".rrd"):
                self._stream.save(where)
            else:
                self._stream.connect_grpc(where)
        except (OSError, RuntimeError, ValueError) as error:
            raise RunError(f"--rerun {where}: {error}") from error
        self._stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        if house is not None:
            colours = np.round(255 * house.open.rgb).astype(np.uint8)
            points = rerun.Points3D(house.open.centers_m, colors=colours, radii=POINT_M)
            self._stream.log("world/scene", points, static=True)
        self._mount()

    def begin(self, moment: LiveMoment, stamp_ns: int) -> None:
        """Show the content that is constant over an episode."""
        rr = self._rr
        self._stream.set_time("time", timestamp=np.datetime64(stamp_ns, "ns"))
        self._stream.log("episode", rr.TextLog(moment.state.episode.episode_id))
        self._stream.log("world/way", rr.LineStrips3D([moment.way[:, :3]], colors=[ROBOT], radii=0.02))
        goal = (*moment.state.goal_xy_m, moment.state.robot_xyzyaw[2])
        self._stream.log("world/goal", rr.Points3D([goal], colors=[GOAL], radii=0.15))

    def show(self, moment: LiveMoment, stamp_ns: int) -> None:
        """Show a moment; `stamp_ns` is the wall clock."""
        rr, state, stream = self._rr, moment.state, self._stream
        x, y, z, yaw = state.robot_xyzyaw
        stream.set_time("time", timestamp=np.datetime64(stamp_ns, "ns"))
        turn = rr.Quaternion(xyzw=[0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)])
        stream.log("world/robot", rr.Transform3D(translation=[x, y, z], quaternion=turn))
        colours = [HUMANS[k % len(HUMANS)] for k in range(len(state.humans_xyzyaw))]
        bodies = rr.Capsules3D(
            lengths=[BODY_HEIGHT_M - 2 * BODY_RADIUS_M] * len(colours),
            radii=[BODY_RADIUS_M] * len(colours),
            translations=[(x, y, z + BODY_RADIUS_M) for x, y, z, _ in state.humans_xyzyaw],
            colors=colours,
        )
        stream.log("world/humans", bodies)
        for name, image in moment.images.items():
            entity = _entity(camera_of(name))
            if kind_of(name) == RGB:
                shown = rr.EncodedImage(contents=image, media_type=f"image/{moment.image_format}")
                stream.log(entity, shown)
            else:
                stream.log(f"{entity}/{kind_of(name)}", rr.EncodedDepthImage(blob=image, meter=1e-3))
        self._show_perception(moment.perception)
        numbers = {"speed_mps": state.v_mps, "turn_radps": state.w_radps, "human_distance_m": state.human_distance_m}
        for name, value in numbers.items():
            if math.isfinite(value):
                stream.log(f"numbers/{name}", rr.Scalars(value))

    def _show_perception(self, perception: LivePerception | None) -> None:
        """Tracks with covariances and velocities, boxes of the humans in the image, and the free space."""
        if perception is None:
            return
        rr, height_m = self._rr, perception.robot_xyzyaw[2] + LIFT_M
        half = (HUMAN_HALF_WIDTH_M, HUMAN_HALF_WIDTH_M, HUMAN_HEIGHT_M / 2)
        boxes = rr.Boxes3D(
            centers=[(*human.xy_m, perception.robot_xyzyaw[2] + HUMAN_HEIGHT_M / 2) for human in perception.detections],
            half_sizes=[half] * len(perception.detections),
            labels=[f"{100 * human.presence:.0f} %" for human in perception.detections],
            colors=[PERCEIVED],
        )
        tracks = perception.tracks
        arrows = rr.Arrows3D(
            origins=[(*track.xy_m, height_m) for track in tracks],
            vectors=[(AHEAD_S * track.v_mps[0], AHEAD_S * track.v_mps[1], 0.0) for track in tracks],
            colors=[PERCEIVED],
        )
        outlines = [raise_points(covariance_ellipse(track), height_m) for track in tracks]
        free = raise_points(free_points(perception, self._robot.camera), height_m)
        for name, shape in {
            "humans": boxes,
            "velocities": arrows,
            "tracks": rr.LineStrips3D(outlines, colors=[PERCEIVED], radii=0.015),
            "free": rr.LineStrips3D([free], colors=[FREE], radii=0.01),
        }.items():
            self._stream.log(f"world/perceived/{name}", shape)

    def close(self) -> None:
        """Close the recording."""
        self._stream.flush()
        self._stream.disconnect()

    def _mount(self) -> None:
        """The robot's body and cameras in its own frame."""
        rr, robot = self._rr, self._robot
        body = rr.Cylinders3D(
            lengths=[robot.height_m], radii=[robot.radius_m], centers=[(0.0, 0.0, robot.height_m / 2)], colors=[ROBOT]
        )
        self._stream.log("world/robot/body", body, static=True)
        for name, camera in {"": robot.camera, **robot.cameras}.items():
            T_robot_camera = camera.T_world_camera(0.0, 0.0, 0.0, 0.0)
            w, x, y, z = quat_from_matrix(T_robot_camera[:3, :3]).tolist()
            place = rr.Transform3D(translation=T_robot_camera[:3, 3], quaternion=rr.Quaternion(xyzw=[x, y, z, w]))
            lens = rr.Pinhole(image_from_camera=camera.K_px, resolution=[camera.width_px, camera.height_px])
            self._stream.log(_entity(name), place, static=True)
            self._stream.log(_entity(name), lens, static=True)


def raise_points(xy_m: Float64Array, height_m: float) -> Float64Array:
    """Points at a height [m], shape (N, 2) -> (N, 3)."""
    return np.column_stack([xy_m, np.full(len(xy_m), height_m)])


def _entity(camera: str) -> str:
    """Entity path of a camera; the first camera is called ""."""
    return f"world/robot/{camera_frame(camera)}"
