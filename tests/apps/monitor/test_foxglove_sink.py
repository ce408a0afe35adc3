import math
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from readygo.apps.fleet.run import record
from readygo.apps.monitor.feed import LiveMoment
from readygo.apps.monitor.recorded import Recorded
from readygo.apps.monitor.subject import subjects_of
from readygo.apps.monitor.track import track_of
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.dataset import Dataset, schemas
from readygo.common.dataset.schemas import Channel
from readygo.common.episode import EpisodeConfig
from readygo.common.messages import Split
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.services.renderer import RendererConfig
from tests.apps.monitor.test_track import TWO_CAMERAS, recorded, recorded_by_two
from tests.common.perception.test_live import perception

foxglove = pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: readygo[foxglove]")


def test_channels_frames_and_markers_are_those_of_shards(tmp_path: Path) -> None:
    from readygo.apps.monitor.foxglove_sink import FoxgloveSink

    sink = FoxgloveSink(RobotConfig(), None, 0)
    assert sink.port > 0
    file = tmp_path / "seen.mcap"
    with foxglove.open_mcap(file, context=sink.context):
        track = track_of(recorded())
        way = np.array([state.robot_xyzyaw for state in track.states])
        for state in track.states[:3]:
            moment = LiveMoment(state=state, images=track.images_at(state.time_ns / 1e9), way=way)
            sink.begin(moment, 1_000 + state.time_ns)
            sink.show(moment, 1_000 + state.time_ns)
    sink.close()
    with file.open("rb") as stream:
        found = [
            (channel.topic, schema.name, message) for schema, channel, message in make_reader(stream).iter_messages()
        ]
    expected = (*schemas.SAMPLE_CHANNELS, schemas.TRANSFORMS, schemas.MARKERS, schemas.BODIES, schemas.ROS_CALIBRATION)
    names = {(topic, schema) for topic, schema, _ in found}
    assert {(channel.topic, channel.message.DESCRIPTOR.full_name) for channel in expected} <= names
    images = [_parsed(schemas.IMAGE, message.data) for topic, _, message in found if topic == schemas.IMAGE.topic]
    assert [image.data for image in images] == [
        image for _, image in [(t, seen["rgb"]) for t, seen in track.images[:3]]
    ]
    frames = [_parsed(schemas.TRANSFORMS, m.data) for topic, _, m in found if topic == schemas.TRANSFORMS.topic]
    assert [frame.child_frame_id for frame in frames[0].transforms] == [schemas.ROBOT_FRAME, schemas.CAMERA_FRAME]
    x, y, *_ = track.states[2].robot_xyzyaw
    place = frames[2].transforms[0].translation
    assert (place.x, place.y) == pytest.approx((x, y))


def test_what_a_driver_perceives_is_a_scene_of_tracks_arrows_and_free_space(tmp_path: Path) -> None:
    from readygo.apps.monitor.foxglove_sink import LIFT_M, FoxgloveSink

    sink, told = FoxgloveSink(RobotConfig(), None, 0), perception()
    state = track_of(recorded()).states[0]
    with foxglove.open_mcap(tmp_path / "seen.mcap", context=sink.context):
        moment = LiveMoment(state=state, way=np.array([state.robot_xyzyaw]), perception=told)
        sink.begin(moment, 1_000)
        sink.show(moment, 1_000)
    sink.close()
    with (tmp_path / "seen.mcap").open("rb") as stream:
        found = {channel.topic: message.data for _, channel, message in make_reader(stream).iter_messages()}
    track, free = _parsed(schemas.PERCEPTION, found["/perception"]).entities
    assert (track.id, free.id) == ("track 0", "free space")
    (arrow,), (person,) = track.arrows, told.tracks
    speed = math.hypot(*person.v_mps)
    assert arrow.shaft_length + arrow.head_length == pytest.approx(speed)
    assert (arrow.pose.position.x, arrow.pose.position.y) == pytest.approx(person.xy_m)
    assert arrow.pose.position.z == pytest.approx(told.robot_xyzyaw[2] + LIFT_M)
    assert 2 * math.atan2(arrow.pose.orientation.z, arrow.pose.orientation.w) == pytest.approx(
        math.atan2(person.v_mps[1], person.v_mps[0])
    )
    assert f"{speed:.1f} m/s" in track.texts[0].text
    assert len(free.lines[0].points) == len(told.rays_m)


def test_every_camera_has_channels_of_its_own(tmp_path: Path) -> None:
    from readygo.apps.monitor.foxglove_sink import FoxgloveSink

    sink = FoxgloveSink(TWO_CAMERAS, None, 0)
    track = track_of(recorded_by_two())
    with foxglove.open_mcap(tmp_path / "seen.mcap", context=sink.context):
        images = {**track.images_at(0.0), "elsewhere.rgb": b"a camera that the robot has not"}
        moment = LiveMoment(state=track.states[0], images=images, way=np.array([track.states[0].robot_xyzyaw]))
        sink.begin(moment, 1_000)
        sink.show(moment, 1_000)
    sink.close()
    with (tmp_path / "seen.mcap").open("rb") as stream:
        found = {channel.topic: message.data for _, channel, message in make_reader(stream).iter_messages()}
    assert _parsed(schemas.IMAGE, found["/camera/left/image"]).data == track.images_at(0.0)["left.rgb"]
    assert _parsed(schemas.IMAGE, found["/camera/left/depth"]).data == track.images_at(0.0)["left.depth"]
    assert _parsed(schemas.ROS_CALIBRATION, found["/camera/left/calibration"]).width == 20
    assert not any("elsewhere" in topic for topic in found)


def test_calibrations_are_those_of_the_shard_lens_and_all(tmp_path: Path) -> None:
    from readygo.apps.monitor.foxglove_sink import FoxgloveSink

    wide = CameraConfig(height_px=24, width_px=40, distortion="fisheye", k1=0.1)
    left = CameraConfig(height_px=24, width_px=40, distortion="brown_conrady", k1=-0.02, p1=0.01, mount_yaw_deg=75.0)
    config = RunConfig(
        robot=RobotConfig(camera=wide, cameras={"left": left}),
        episode=EpisodeConfig(goal_distance_max_m=4.0),
        renderer=RendererConfig(sensor=SensorConfig(k1=(-0.05, 0.05))),
    )
    spec = make_spec(open_scene("embedded"), None, config, seed=0, split=Split.TRAIN, static=True)
    record(spec, tmp_path / "data", episodes=1, workers=0)
    (subject,) = subjects_of(tmp_path / "data")
    recorded, dataset = Recorded(tmp_path / "data"), Dataset(tmp_path / "data")
    track = recorded.track(dataset.episodes[0].episode)
    assert track is not None
    sink = FoxgloveSink(subject.robot, None, 0, subject.sensor)
    with foxglove.open_mcap(tmp_path / "seen.mcap", context=sink.context):
        sink.begin(LiveMoment(state=track.states[0], way=np.array([track.states[0].robot_xyzyaw])), 1_000)
    sink.close()
    with (tmp_path / "seen.mcap").open("rb") as stream:
        live = {channel.topic: message.data for _, channel, message in make_reader(stream).iter_messages()}
    assert dataset.calibration(0).distortion_model == "kannala_brandt"
    assert dataset.calibration(0, "left").distortion_model == "plumb_bob"
    for name, topic in (("", "/camera/calibration"), ("left", "/camera/left/calibration")):
        told, ours = _parsed(schemas.ROS_CALIBRATION, live[topic]), dataset.calibration(0, name)
        assert (told.distortion_model, tuple(told.D)) == (ours.distortion_model, ours.distortion)
        at_integers = ours.K_px - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
        np.testing.assert_array_equal(np.reshape(told.K, (3, 3)), at_integers)


def _parsed(channel: Channel, payload: bytes):
    message = channel.message()
    message.ParseFromString(payload)
    return message
