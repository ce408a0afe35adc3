"""People and free distances around a robot, perceived in its images beside the policy that drives."""

import math

import numpy as np

from readygo.apps.drive.calibration import Rectifier
from readygo.apps.drive.free_space import scan_of
from readygo.apps.drive.messages import ImageMessage, OdometryMessage, PeopleMessage, ScanMessage
from readygo.common.camera import CameraConfig
from readygo.common.frames import wrap_angle
from readygo.common.perception import PeopleTracker, Perceived, Perception
from readygo.common.perception.episode import LOOK_S
from readygo.common.perception.grid import polar_grid
from readygo.common.perception.live import tracked_person

SLACK = 0.8
"""Share of `LOOK_S` after which an image is looked at."""
CLEAR_M = 6.0
"""Farther humans may be missed where nothing hides them [m]."""
_BODY_M = 0.3
"""A human may hide behind things that are this much nearer [m]."""


class PeopleFinder:
    """Tracks people in the odometry's frame. One thread calls its methods; times are stamps of the robot's clock."""

    def __init__(self, perception: Perception, rectify: Rectifier) -> None:
        """Begin.

        Args:
            perception: Tells what images show.
            rectify: Converts the robot's images to those of the camera that perception was trained with.
        """
        self._perception, self._rectify = perception, rectify
        self._memory, self._tracker = perception.start(), PeopleTracker(None, None)
        self._odometry: OdometryMessage | None = None
        self._yaw_rad = 0.0
        self._looked_ns = 0

    def hear(self, odometry: OdometryMessage, arrived_ns: int) -> None:
        """Process an odometry message; arguments as in `Pilot.hear`."""
        before, stamp_ns = self._odometry, odometry.stamp_ns or arrived_ns
        numbers = (odometry.x_m, odometry.y_m, odometry.yaw_rad, odometry.v_mps, odometry.w_radps)
        if not all(map(math.isfinite, numbers)) or (before is not None and stamp_ns <= before.stamp_ns):
            return
        turned = odometry.yaw_rad if before is None else float(wrap_angle(odometry.yaw_rad - before.yaw_rad))
        self._yaw_rad = turned if before is None else self._yaw_rad + turned
        self._odometry = odometry.at(stamp_ns)
        self._memory.move(stamp_ns, (odometry.x_m, odometry.y_m, self._yaw_rad))

    def look(self, picture: ImageMessage, arrived_ns: int) -> tuple[PeopleMessage, ScanMessage] | None:
        """Process an image of the first camera.

        Args:
            picture: The image.
            arrived_ns: Its arrival [ns].

        Returns:
            The tracked people and the free distances at the image's time; None if this image is not looked at.
        """
        stamp_ns, odometry = picture.stamp_ns or arrived_ns, self._odometry
        since_s = (stamp_ns - self._looked_ns) / 1e9
        if odometry is None or since_s < SLACK * LOOK_S:
            return None
        try:
            image = self._rectify(np.asarray(picture.decode(), np.uint8))
        except ValueError:
            return None
        self._memory.see(image, stamp_ns)
        command = np.array((odometry.v_mps, odometry.w_radps), np.float32)
        perceived = self._perception.perceive(self._memory, command)
        if self._looked_ns:
            self._tracker.predict(since_s)
        self._looked_ns = stamp_ns
        pose, camera = self._memory.pose_at(stamp_ns), self._perception.spec.robot.camera
        self._tracker.fuse(pose, perceived.people, lambda x, y: shows(perceived, camera, pose, x, y))
        people = tuple(map(tracked_person, self._tracker.known))
        scan = scan_of(perceived.rays_m, camera, stamp_ns=stamp_ns, frame=odometry.robot_frame)
        return PeopleMessage(stamp_ns=stamp_ns, frame=odometry.frame, people=people), scan


def shows(perceived: Perceived, camera: CameraConfig, pose: tuple[float, float, float], x_m: float, y_m: float) -> bool:
    """True if a human at a place would be in the image: in view, and nearer than what the free distances end at.

    Args:
        perceived: What the image told.
        camera: The camera.
        pose: The robot when the image was taken: x, y [m], yaw [rad].
        x_m: The human [m].
        y_m: The human [m].
    """
    eye_x, eye_y, looks_rad = camera.eye(*pose)
    distance_m = math.hypot(x_m - eye_x, y_m - eye_y)
    bearing_rad = float(wrap_angle(math.atan2(y_m - eye_y, x_m - eye_x) - looks_rad))
    grid = polar_grid(camera)
    if distance_m > CLEAR_M or not grid.bearings_rad[-1] < bearing_rad < grid.bearings_rad[0]:
        return False
    column = int(grid.column_of(np.array([bearing_rad]))[0])
    return distance_m < float(perceived.rays_m[column]) + _BODY_M
