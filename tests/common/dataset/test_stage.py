"""Episodes among frames, markers and the map, as viewers get them."""

import itertools
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from mcap.reader import NonSeekingReader, make_reader

from readygo.common.dataset import Dataset, columns, validate
from readygo.common.dataset import schemas as s
from readygo.common.dataset.columns import Part, Pieces
from readygo.common.dataset.packed import Messages
from readygo.common.dataset.stage import PAUSE_NS, Scenery
from readygo.common.frames import matrix_from_quat
from readygo.common.robot.kinematics import STEP_NS
from tests.common.dataset.episodes import ROBOT, write_shard
from tests.common.dataset.maps import make_maps

STAGE = Scenery(robot=ROBOT, maps=make_maps())
CHANNELS = {channel.topic: channel for channel in s.staged_channels(s.OPTIONAL_CHANNELS)}


def messages_on(shard: Path, topic: str) -> list[tuple[int, Any]]:
    """(Log time [ns], message) of everything on a topic."""
    with shard.open("rb") as file:
        found = list(make_reader(file, validate_crcs=True).iter_messages(topics=topic))
    return [(message.log_time, CHANNELS[topic].message.FromString(message.data)) for _, _, message in found]


def matrix_of(transform: Any) -> np.ndarray:
    T = np.eye(4)
    q, p = transform.rotation, transform.translation
    T[:3, :3] = matrix_from_quat([q.w, q.x, q.y, q.z])
    T[:3, 3] = (p.x, p.y, p.z)
    return T


def test_time_runs_on_from_episode_to_episode_in_the_order_of_recording(tmp_path) -> None:
    shard = write_shard(tmp_path, [7, 0, 3], stage=STAGE)
    with shard.open("rb") as file:
        times = [message.log_time for _, _, message in NonSeekingReader(file).iter_messages(log_time_order=False)]
    with shard.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert times == sorted(times)
    spans = [(index.message_start_time, index.message_end_time) for index in summary.chunk_indexes]
    assert spans[0] == (0, 11 * STEP_NS)
    assert all(after[0] == before[1] + PAUSE_NS for before, after in itertools.pairwise(spans))


def test_readers_and_validation_see_the_same_samples(tmp_path) -> None:
    plain = write_shard(tmp_path / "plain", [2, 0], labels=True, outputs=("depth",))
    staged = write_shard(tmp_path / "staged", [2, 0], labels=True, outputs=("depth",), stage=STAGE)
    report = validate(staged.parent)
    assert report.ok, report.defects
    one, other = Dataset(plain.parent), Dataset(staged.parent)
    assert one.content_hash == other.content_hash
    for name in ("actions", "goals_xy_m", "time_ns", "poses", "truth"):
        assert (getattr(one, name) == getattr(other, name)).all()
    for sample in (0, 13, len(one) - 1):
        assert one.image(sample) == other.image(sample)
        assert one.output(sample, "depth") == other.output(sample, "depth")
        assert (one.boxes(sample) == other.boxes(sample)).all()
        assert (one.calibration(sample).K_px == other.calibration(sample).K_px).all()


def test_frames_lead_from_the_world_to_the_camera(tmp_path) -> None:
    shard = write_shard(tmp_path, [1], stage=STAGE)
    poses = Dataset(tmp_path).poses
    found = messages_on(shard, "/tf")
    assert len(found) == len(poses)
    for (time_ns, message), pose in zip(found, poses, strict=True):
        robot, camera = message.transforms
        assert (robot.parent_frame_id, robot.child_frame_id) == ("world", "robot")
        assert (camera.parent_frame_id, camera.child_frame_id) == ("robot", "camera")
        assert {part.timestamp.ToNanoseconds() for part in message.transforms} == {time_ns}
        x_m, y_m, floor_m, yaw_rad = pose.tolist()
        want = ROBOT.camera.T_world_camera(x_m, y_m, yaw_rad, floor_m)
        np.testing.assert_allclose(matrix_of(robot) @ matrix_of(camera), want, atol=1e-12)


def test_calibration_has_pixel_centres_at_integers(tmp_path) -> None:
    shard = write_shard(tmp_path, [1], stage=STAGE)
    ((_, calibration),) = messages_on(shard, "/camera/calibration")
    assert (calibration.K[2], calibration.K[5]) == (ROBOT.camera.width_px / 2 - 0.5, ROBOT.camera.height_px / 2 - 0.5)


def test_the_map_is_once_in_a_shard_before_the_first_sample(tmp_path) -> None:
    shard = write_shard(tmp_path, [5, 6], stage=STAGE)
    for topic in ("/map", "/map/points"):
        ((time_ns, message),) = messages_on(shard, topic)
        assert (time_ns, message.timestamp.ToNanoseconds(), message.frame_id) == (0, 0, "world")


def test_markers_show_start_goal_way_and_robot(tmp_path) -> None:
    shard = write_shard(tmp_path, [5], stage=STAGE)
    ((_, update),) = messages_on(shard, "/episode/markers")
    entities = {entity.id: entity for entity in update.entities}
    assert list(entities) == ["start", "goal", "path", "robot"]
    poses, goal = Dataset(tmp_path).poses, entities["goal"].cylinders[0].pose.position
    assert (goal.x, goal.y) == (4.0, 1.0)
    way = [(point.x, point.y) for point in entities["path"].lines[0].points]
    np.testing.assert_array_equal(way, poses[:, :2])
    assert (entities["robot"].frame_id, entities["robot"].frame_locked) == ("robot", True)
    assert entities["robot"].cylinders[0].size.x == 2 * ROBOT.radius_m
    assert len(messages_on(shard, "/episode/path")) == len(messages_on(shard, "/robot/outline")) == 1


def test_people_are_entities_with_labels_and_without(tmp_path) -> None:
    plain = write_shard(tmp_path / "plain", [1], stage=STAGE)
    labelled = write_shard(tmp_path / "labelled", [1], labels=True, stage=STAGE)
    bodies = messages_on(plain, "/humans/bodies")
    assert len(bodies) == 12
    for (time_ns, update), humans in zip(bodies, Dataset(plain.parent).humans_xyzyaw, strict=True):
        (entity,) = update.entities
        assert entity.timestamp.ToNanoseconds() == time_ns
        position = entity.cylinders[0].pose.position
        assert (position.x, position.y) == tuple(humans[0, :2])
    assert messages_on(labelled, "/humans/bodies") == []
    assert len(messages_on(labelled, "/humans/boxes")) == 12


def test_without_robot_and_maps_there_are_frames_and_ways_only(tmp_path) -> None:
    shard = write_shard(tmp_path, [1], stage=Scenery())
    assert [len(message.transforms) for _, message in messages_on(shard, "/tf")] == [1] * 12
    assert not [*messages_on(shard, "/map"), *messages_on(shard, "/map/points"), *messages_on(shard, "/robot/outline")]
    assert validate(tmp_path).ok


def test_a_frame_that_is_not_at_the_pose_is_a_defect(tmp_path, monkeypatch) -> None:
    def misplaced(self: Scenery, position: Part, orientation: Part) -> Messages:
        positions = [Vector3.FromString(row) for row in columns.rows_of([position])]
        for seq in (4, 6):
            positions[seq].x += 0.01
        return frames(self, Pieces([moved.SerializeToString() for moved in positions]), orientation)

    frames = Scenery.frames
    monkeypatch.setattr(Scenery, "frames", misplaced)
    write_shard(tmp_path, [1], stage=STAGE)
    (defect,) = validate(tmp_path).defects
    assert defect.kind == "frame"
    assert defect.text == "episode train-7-000001: the robot's frame is not at its pose at samples 4, 6"


@pytest.fixture
def rerun(tmp_path):
    """Runs Rerun's command line tool and returns what it prints."""
    pytest.importorskip("rerun", reason="needs rerun-sdk, which readygo does not depend on")

    def run(*arguments: str) -> str:
        command = [sys.executable, "-m", "rerun", *arguments]
        result = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert result.returncode == 0, result.stderr
        return result.stdout

    return run


def test_rerun_finds_nothing_wrong_and_knows_where_everything_is(tmp_path, rerun) -> None:
    shard = write_shard(tmp_path, [3, 1], labels=True, stage=STAGE)
    lines = [line for line in rerun("mcap", "check", "--full", str(shard)).splitlines() if " /" in line]
    assert len(lines) == 18
    assert all(line.startswith("ok") for line in lines), lines
    rerun("mcap", "convert", str(shard), "-o", str(tmp_path / "shard.rrd"))
    text = rerun("rrd", "print", "-vvv", str(tmp_path / "shard.rrd"))
    for component in (
        "Transform3D:parent_frame",
        "Transform3D:child_frame",
        "Pinhole:image_from_camera",
        "EncodedImage:blob",
        "Points3D:positions",
        "CoordinateFrame:frame",
    ):
        assert component in text
