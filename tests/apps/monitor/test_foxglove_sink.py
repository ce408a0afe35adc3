from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from readygo.apps.monitor.feed import Moment
from readygo.apps.monitor.track import track_of
from readygo.common.dataset import schemas
from readygo.common.dataset.schemas import Channel
from readygo.common.robot import RobotConfig
from tests.apps.monitor.test_track import TWO_CAMERAS, recorded, recorded_by_two

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
            moment = Moment(state=state, images=track.images_at(state.time_ns / 1e9), way=way)
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


def test_every_camera_has_channels_of_its_own(tmp_path: Path) -> None:
    from readygo.apps.monitor.foxglove_sink import FoxgloveSink

    sink = FoxgloveSink(TWO_CAMERAS, None, 0)
    track = track_of(recorded_by_two())
    with foxglove.open_mcap(tmp_path / "seen.mcap", context=sink.context):
        images = {**track.images_at(0.0), "elsewhere.rgb": b"a camera that the robot has not"}
        moment = Moment(state=track.states[0], images=images, way=np.array([track.states[0].robot_xyzyaw]))
        sink.begin(moment, 1_000)
        sink.show(moment, 1_000)
    sink.close()
    with (tmp_path / "seen.mcap").open("rb") as stream:
        found = {channel.topic: message.data for _, channel, message in make_reader(stream).iter_messages()}
    assert _parsed(schemas.IMAGE, found["/camera/left/image"]).data == track.images_at(0.0)["left.rgb"]
    assert _parsed(schemas.IMAGE, found["/camera/left/depth"]).data == track.images_at(0.0)["left.depth"]
    assert _parsed(schemas.ROS_CALIBRATION, found["/camera/left/calibration"]).width == 20
    assert not any("elsewhere" in topic for topic in found)


def _parsed(channel: Channel, payload: bytes):
    message = channel.message()
    message.ParseFromString(payload)
    return message
