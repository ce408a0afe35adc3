import time
from contextlib import closing
from dataclasses import replace

import pytest

from readygo.apps.drive.messages import PeopleMessage, ScanMessage, VelocityMessage
from readygo.apps.drive.robot import DEADMAN_S, Topics, connect_robot
from readygo.apps.drive.ros_codec import IMAGE_TYPE, PEOPLE_TYPE, SCAN_TYPE, TWIST_TYPE
from readygo.apps.drive.wires import RosWire
from readygo.apps.robot_logs.reader import LogCamera
from readygo.common.bus.foreign import ForeignSession
from readygo.common.bus.zenoh_bus import Router, free_endpoint
from readygo.common.errors import BusError
from tests.apps.drive.conftest import T0, odometry

pytest.importorskip("rosbags", reason="rosbags (extra robot-logs) is not installed")
TOPICS = Topics(image="/camera/image_raw", odometry="/odom", command="/cmd_vel")


@pytest.fixture
def network():
    endpoint = free_endpoint()
    with closing(Router(endpoint)), closing(ForeignSession(endpoint)) as session:
        yield endpoint, session


def waited(ask, seconds=5.0):
    until_s = time.monotonic() + seconds
    while not ask() and time.monotonic() < until_s:
        time.sleep(0.01)
    return ask()


def test_robot_is_told_to_stand_when_nobody_commands_it_and_when_it_is_left(network):
    endpoint, session = network
    wire, told = RosWire(0, "drive"), []
    session.hear(
        "0/cmd_vel/**", lambda key, payload, attachment: told.append((wire.codec.read(TWIST_TYPE, payload), attachment))
    )
    robot = connect_robot(endpoint, wire, TOPICS, dry=False)
    robot.send(VelocityMessage(v_mps=0.5))
    assert waited(lambda: len(told) > 0)
    assert told[-1][0] == VelocityMessage(v_mps=0.5)
    assert len(told[-1][1]) == 33
    assert waited(lambda: told[-1][0] == VelocityMessage(), DEADMAN_S + 3.0)
    robot.send(VelocityMessage(v_mps=0.5))
    robot.close()
    assert waited(lambda: told[-1][0] == VelocityMessage())


def test_messages_of_another_type_and_bytes_that_are_none_are_said(network):
    endpoint, session = network
    wire = RosWire(0, "drive")
    robot = connect_robot(endpoint, wire, TOPICS, dry=True)
    sender = session.publisher("0/odom/nav_msgs::msg::dds_::Odometry_/x")
    assert sender.heard(3.0)
    sender.put(wire.codec.write("nav_msgs/msg/Odometry", odometry(T0, x_m=1.5), T0))
    found = []
    assert waited(lambda: found or found.extend(robot.odometry()) or found)
    assert found[0][0].x_m == 1.5
    sender.put(b"123")
    assert waited(lambda: robot.broken)
    assert robot.broken == "/odom: 3 bytes are no nav_msgs/msg/Odometry"
    session.publisher("0/camera/image_raw/sensor_msgs::msg::dds_::PointCloud2_/x").put(b"")
    assert waited(lambda: "PointCloud2" in robot.broken)
    assert IMAGE_TYPE in robot.broken
    assert "no ROS 2 node is there" in robot.absent()
    robot.close()


def test_what_is_perceived_is_published_and_logged_also_in_a_dry_run(network):
    endpoint, session = network
    wire, heard, logged = RosWire(0, "drive"), {}, []
    for topic in ("people", "perception/scan"):
        session.hear(f"0/{topic}/**", lambda key, payload, _: heard.update({wire.type_of(key, ""): payload}))
    robot = connect_robot(endpoint, wire, replace(TOPICS, people="/people", scan="/perception/scan"), dry=True)
    robot.listen = lambda topic, kind, value, time_ns: logged.append((topic, kind))
    for publisher in robot._perceived.values():
        assert publisher.heard(3.0)
    scan = ScanMessage(
        stamp_ns=T0, angle_min_rad=0.0, angle_increment_rad=0.1, range_max_m=9.0, period_s=0.1, ranges_m=(1.0, 2.0)
    )
    robot.tell(PeopleMessage(stamp_ns=T0, people=()), scan)
    assert waited(lambda: len(heard) == 2)
    assert heard[SCAN_TYPE] == wire.codec.write(SCAN_TYPE, scan, T0)
    assert logged == [("/people", PEOPLE_TYPE), ("/perception/scan", SCAN_TYPE)]
    robot.close()


def test_nobody_there_is_said(network, monkeypatch):
    monkeypatch.setattr("readygo.apps.drive.robot.FOUND_S", 0.1)
    with pytest.raises(BusError, match=r"No subscriber listens to /cmd_vel\. Start the robot's base"):
        connect_robot(network[0], RosWire(0, "drive"), TOPICS, dry=False)


def test_robot_knows_the_frame_of_its_odometry_and_the_cameras_of_rectified_images(network):
    endpoint, _ = network
    wire = RosWire(0, "drive")
    topics = replace(
        TOPICS,
        image="/camera/image_rect_color/compressed",
        camera_info="/camera/camera_info",
        beside={"left.rgb": "/left/image_raw"},
        infos={"left": "/left/camera_info"},
    )
    robot = connect_robot(endpoint, wire, topics, dry=True)
    assert robot.frame is None
    info = LogCamera(height_px=4, width_px=6, K_px=(5.0,) * 9, model="plumb_bob", distortion=(0.1,), P_px=(7.0,) * 12)
    for topic in ("/camera/camera_info", "/left/camera_info"):
        robot._keep(topic, info, 0)
    assert (robot.cameras[""].K_px, robot.cameras[""].distortion) == ((7.0,) * 9, ())
    assert robot.cameras["left"] == info
    robot._keep("/odom", odometry(T0), 0)
    assert robot.frame == "odom"
    robot.close()
