import math
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.apps.drive.calibration import Rectifier
from readygo.apps.drive.messages import ImageMessage
from readygo.apps.drive.people import PeopleFinder, shows
from readygo.common.camera import CameraConfig
from readygo.common.perception.grid import polar_grid
from readygo.common.policy import PolicyMemory
from tests.apps.drive.conftest import CAMERA, T0, S, odometry, picture
from tests.common.perception.test_tracker import seen

COLUMNS = len(polar_grid(CAMERA).bearings_rad)


class FakePerception:
    """Tells of a human at a place of the world, whom the robot sees from the pose that the images say."""

    def __init__(self, where=(3.0, 0.0), free_m=9.0):
        self.spec = SimpleNamespace(robot=SimpleNamespace(camera=CAMERA))
        self.where, self.free_m, self.pose, self.commands = where, free_m, (0.0, 0.0, 0.0), []
        self.left_mps = 0.0

    def start(self):
        return PolicyMemory(round(0.2 * S), frame_count=3)

    def perceive(self, memory, command):
        self.commands.append(tuple(command.tolist()))
        return SimpleNamespace(people=self.people(), rays_m=np.full(COLUMNS, self.free_m))

    def people(self):
        if not self.where:
            return seen()
        x, y, yaw = self.pose
        dx, dy = self.where[0] - x, self.where[1] - y
        c, s = math.cos(yaw), math.sin(yaw)
        return seen((c * dx + s * dy, c * dy - s * dx, 0.0, self.left_mps))


def finder_of(perception):
    return PeopleFinder(perception, Rectifier(CAMERA, CAMERA))


def test_people_are_in_the_frame_of_the_odometry_at_the_images_time():
    perception = FakePerception(where=())
    finder = finder_of(perception)
    finder.hear(odometry(T0 - S // 10), 0)
    assert finder.look(picture(T0 - S // 10), 0)[0].people == ()
    perception.where = (3.0, 0.0)
    # The image was taken halfway between two poses of the odometry.
    finder.hear(odometry(T0, x_m=0.0, yaw_rad=0.0, v_mps=0.5), 0)
    finder.hear(odometry(T0 + S // 10, x_m=1.0, yaw_rad=0.4, v_mps=0.5), 0)
    perception.pose = (0.5, 0.0, 0.2)
    told, scan = finder.look(picture(T0 + S // 20), 0)
    assert (scan.stamp_ns, scan.frame) == (T0 + S // 20, "base_link")
    assert max(scan.ranges_m) == pytest.approx(perception.free_m)
    assert (told.stamp_ns, told.frame) == (T0 + S // 20, "odom")
    (person,) = told.people
    assert person.xy_m == pytest.approx((3.0, 0.0), abs=1e-6)
    assert perception.commands == [(0.0, 0.0), (0.5, 0.0)]


def test_images_are_looked_at_ten_times_a_second_and_a_human_keeps_its_number():
    perception = FakePerception()
    finder, told = finder_of(perception), []
    perception.left_mps = 1.0
    for step in range(20):
        finder.hear(odometry(T0 + step * S // 20), 0)
        perception.where = (3.0, 0.05 * step)
        told.append(finder.look(picture(T0 + step * S // 20), 0))
    looks = [each[0] for each in told if each is not None]
    assert len(looks) == 10
    assert {person.number for each in looks for person in each.people} == {0}
    # 0.05 m each 0.05 s to the left.
    assert looks[-1].people[0].v_mps == pytest.approx((0.0, 1.0), abs=0.1)


def test_nothing_is_told_before_the_odometry_or_of_a_broken_image():
    finder = finder_of(FakePerception())
    assert finder.look(picture(T0), 0) is None
    finder.hear(odometry(T0, x_m=math.nan), 0)
    assert finder.look(picture(T0), 0) is None
    finder.hear(odometry(T0), 0)

    def broken():
        raise ValueError

    assert finder.look(ImageMessage(stamp_ns=T0, decode=broken), 0) is None
    assert finder.look(picture(T0, size=(4, 4)), 0) is None
    assert finder.look(picture(T0), 0) is not None


def test_human_who_stays_away_is_forgotten_only_where_the_image_would_show_one():
    perception = FakePerception()
    finder = finder_of(perception)
    finder.hear(odometry(T0), 0)
    (first,) = finder.look(picture(T0), 0)[0].people
    perception.where, perception.free_m = (), 1.0
    for step in range(1, 4):
        assert finder.look(picture(T0 + step * S // 10), 0)[0].people[0].number == first.number
    perception.free_m = 9.0
    for step in range(4, 14):
        told, _ = finder.look(picture(T0 + step * S // 10), 0)
    assert told.people == ()


def test_camera_shows_what_is_in_view_and_nearer_than_what_hides_it():
    camera = CameraConfig(mount_x_m=0.1)
    perceived = SimpleNamespace(rays_m=np.full(COLUMNS, 2.0))
    pose = (1.0, 1.0, math.pi / 2)
    assert shows(perceived, camera, pose, 1.0, 3.0)
    assert not shows(perceived, camera, pose, 1.0, 4.0)
    assert not shows(perceived, camera, pose, 1.0, 0.0)
    far = SimpleNamespace(rays_m=np.full(COLUMNS, 10.0))
    assert not shows(far, camera, pose, 1.0, 9.0)
