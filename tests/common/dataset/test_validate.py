import dataclasses

import numpy as np
import pytest
from google.protobuf.timestamp_pb2 import Timestamp

from readygo.common.dataset import Provenance, ShardWriter, encode_episode, labels, schemas, validate
from readygo.common.dataset.index import index_path, load_index, write_index
from readygo.common.dataset.labels import joints_of
from readygo.common.errors import DatasetError
from readygo.common.images.files import encode_output
from tests.common.dataset.episodes import (
    PROVENANCE,
    jpeg,
    make_episode,
    make_images,
    make_labels,
    provenance_with_robot,
    write_shard,
)
from tests.common.dataset.forge import chunks_of, rewrite


@pytest.fixture
def shard(tmp_path):
    return write_shard(tmp_path, [0, 1])


def kinds(folder) -> set[str]:
    return {defect.kind for defect in validate(folder).defects}


def texts(folder) -> str:
    return "\n".join(map(str, validate(folder).defects))


def at(records, channel, sequence):
    return next(record for record in records if record.channel is channel and record.sequence == sequence)


def test_good_dataset_has_no_defects_and_is_counted(shard) -> None:
    progress = []
    report = validate(shard.parent, progress=lambda done, total: progress.append((done, total)))
    assert report.ok
    assert (report.shard_count, report.episode_count, report.sample_count) == (1, 2, 24)
    assert report.notes == ()
    size = shard.stat().st_size
    assert progress[-1] == (size, size)
    assert len(progress) == 3


def test_missing_folder_is_an_error_not_a_defect(tmp_path) -> None:
    with pytest.raises(DatasetError, match="does not exist"):
        validate(tmp_path / "nowhere")


def test_rewriting_without_a_change_is_no_defect(shard) -> None:
    rewrite(shard, lambda records: records)
    assert validate(shard.parent).ok


def test_flipped_byte_in_an_image_is_found(shard) -> None:
    offset = int(load_index(shard).samples[5]["image_offset"])
    data = bytearray(shard.read_bytes())
    data[offset + 50] ^= 1
    shard.write_bytes(data)
    assert {"crc", "sha256"} <= kinds(shard.parent)
    assert "chunk at byte" in texts(shard.parent)


def test_any_flipped_byte_of_the_file_is_found(tmp_path) -> None:
    shard = write_shard(tmp_path, [0], sample_count=1)
    data = shard.read_bytes()
    for offset in range(3, len(data), max(1, len(data) // 150)):
        damaged = bytearray(data)
        damaged[offset] ^= 0x04
        shard.write_bytes(damaged)
        assert not validate(tmp_path).ok, offset


def test_every_truncation_is_found(shard) -> None:
    data = shard.read_bytes()
    for cut in (1, 9, 40, 500, len(data) // 2, len(data) - 3, len(data)):
        shard.write_bytes(data[:-cut])
        assert kinds(shard.parent) == {"file"}


@pytest.mark.parametrize("channel", schemas.SAMPLE_CHANNELS, ids=lambda channel: channel.topic)
def test_dropped_message_is_found(shard, channel) -> None:
    rewrite(shard, lambda records: [r for r in records if not (r.channel is channel and r.sequence == 4)])
    assert f"{channel.topic} lacks samples 4" in texts(shard.parent)


def test_dropped_last_sample_is_found(shard) -> None:
    rewrite(shard, lambda records: [r for r in records if r.sequence != 11])
    assert "lacks samples 11" in texts(shard.parent)


@pytest.mark.parametrize("channel", [schemas.EPISODE_START, schemas.EPISODE_COMMIT, schemas.CALIBRATION])
def test_missing_frame_of_an_episode_is_found(shard, channel) -> None:
    rewrite(shard, lambda records: [r for r in records if r.channel is not channel])
    assert f"there are 0 messages on {channel.topic}" in texts(shard.parent)


def test_messages_in_another_order_are_found(shard) -> None:
    rewrite(shard, lambda records: [*records[:2], *records[8:14], *records[2:8], *records[14:]])
    assert "has samples out of order" in texts(shard.parent)


def test_duplicate_episode_is_found(tmp_path) -> None:
    write_shard(tmp_path, [0, 1], number=0)
    write_shard(tmp_path, [2, 1], number=1)
    report = validate(tmp_path)
    assert [(defect.shard, defect.kind) for defect in report.defects] == [("shard-r0-00001.mcap", "duplicate")]
    assert "train-7-000001 is in shard-r0-00000.mcap already" in str(report.defects[0])


def test_wrong_time_stamp_is_found(shard) -> None:
    def late(records):
        at(records, schemas.ACTION, 6).log_time_ns += 1_000_000
        return records

    rewrite(shard, late)
    assert "/robot/action is not at 20 Hz at samples 6" in texts(shard.parent)


def test_gap_in_time_is_found(shard) -> None:
    def gap(records):
        for record in records:
            if record.sequence >= 6:
                record.log_time_ns += 50_000_000
        return records

    rewrite(shard, gap)
    assert "is not at 20 Hz at samples 6, 7, 8, 9, 10 and 1 more" in texts(shard.parent)


def test_stamp_inside_a_message_that_contradicts_its_time_is_found(shard) -> None:
    def stamp(records):
        at(records, schemas.ROBOT_POSE, 3).message.timestamp.nanos += 1
        return records

    rewrite(shard, stamp)
    assert "/robot/pose has other stamps inside at samples 3" in texts(shard.parent)


def test_swapped_images_are_found_by_the_hash(shard) -> None:
    def swap(records):
        one, other = at(records, schemas.IMAGE, 2).message, at(records, schemas.IMAGE, 7).message
        one.data, other.data = other.data, one.data
        return records

    rewrite(shard, swap, rehash=False)
    assert kinds(shard.parent) == {"sha256"}


@pytest.mark.parametrize("data", [b"", b"no image", jpeg(0)[:60], jpeg(0, 24, 30)], ids=["none", "text", "cut", "size"])
def test_bad_image_is_found(shard, data) -> None:
    def replace(records):
        at(records, schemas.IMAGE, 2).message.data = data
        return records

    rewrite(shard, replace)
    assert "image is damaged or has another size or format at samples 2" in texts(shard.parent)


def test_action_beyond_the_limits_is_found(shard) -> None:
    def turn(records):
        at(records, schemas.ACTION, 11).message.w_radps = 1.3
        return records

    rewrite(shard, turn)
    assert "action is beyond the robot's limits at samples 11" in texts(shard.parent)


def test_action_that_is_not_a_number_is_found(shard) -> None:
    def spoil(records):
        at(records, schemas.ACTION, 11).message.v_mps = float("nan")
        return records

    rewrite(shard, spoil)
    assert "action is beyond the robot's limits at samples 11" in texts(shard.parent)


def test_action_that_jumps_is_found(shard) -> None:
    def jump(records):
        at(records, schemas.ACTION, 11).message.v_mps += 0.06
        return records

    rewrite(shard, jump)
    assert "action changes faster than the robot can at samples 11" in texts(shard.parent)


def test_limits_are_those_of_the_recorded_robot(tmp_path) -> None:
    write_shard(tmp_path, [0], provenance=provenance_with_robot(v_max_mps=0.5), sample_count=15)
    assert "beyond the robot's limits at samples 10, 11, 12, 13, 14" in texts(tmp_path)


def test_data_without_a_robot_is_noted(tmp_path) -> None:
    write_shard(tmp_path, [0], provenance=Provenance())
    report = validate(tmp_path)
    assert report.ok
    assert report.notes == ("The metadata names no robot: its limits were not checked.",)


def test_pose_that_does_not_follow_from_the_action_is_found(shard) -> None:
    def shift(records):
        at(records, schemas.ROBOT_POSE, 5).message.pose.position.x += 0.01
        return records

    rewrite(shard, shift)
    found = texts(shard.parent)
    assert "pose does not follow from the pose and the action before at samples 5, 6" in found
    assert "relative goal contradicts the pose and the goal at samples 5" in found


def test_actions_that_are_one_step_late_are_found(tmp_path) -> None:
    header, samples = make_episode(0)
    late = [
        dataclasses.replace(now, action_v_mps=before.action_v_mps, action_w_radps=before.action_w_radps)
        for now, before in zip(samples[1:], samples, strict=False)
    ]
    with ShardWriter(tmp_path / "shard-r0-00000.mcap", PROVENANCE, fsync=False) as writer:
        writer.append(encode_episode(header, 1, [samples[0], *late]))
    assert "motion" in kinds(tmp_path)


def test_episode_that_begins_elsewhere_is_found(shard) -> None:
    def move(records):
        at(records, schemas.EPISODE_START, 0).message.start_x_m += 1.0
        return records

    rewrite(shard, move)
    assert "sample 0 is not at the episode's start pose" in texts(shard.parent)


def test_wrong_relative_goal_is_found(shard) -> None:
    def mirror(records):
        goal = at(records, schemas.GOAL, 8).message
        goal.y_m = -goal.y_m
        return records

    rewrite(shard, mirror)
    assert "relative goal contradicts the pose and the goal at samples 8" in texts(shard.parent)


def test_index_of_other_content_is_found(shard) -> None:
    index = load_index(shard)
    samples = index.samples.copy()
    samples["image_offset"][3] += 1
    write_index(dataclasses.replace(index, samples=samples), index_path(shard))
    assert kinds(shard.parent) == {"index"}
    index_path(shard).write_bytes(b"damaged")
    assert kinds(shard.parent) == {"index"}


def test_missing_index_is_noted(shard) -> None:
    index_path(shard).unlink()
    report = validate(shard.parent)
    assert report.ok
    assert report.notes == ("shard-r0-00000.mcap has no index; readers make it again.",)


def test_open_shards_are_noted(shard) -> None:
    shard.with_name("shard-r0-00001.mcap.part").write_bytes(b"")
    report = validate(shard.parent)
    assert report.ok
    assert "1 shards are open" in report.notes[0]


def test_shard_of_another_robot_is_found(shard) -> None:
    write_shard(shard.parent, [5], number=1, provenance=provenance_with_robot(radius_m=0.2))
    assert "its robot is not that of shard-r0-00000.mcap" in texts(shard.parent)


def test_shard_without_our_metadata_is_found(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("readygo.common.dataset.writer.RECORD_NAME", "somebody-else")
    write_shard(tmp_path, [0])
    assert kinds(tmp_path) == {"metadata"}


def test_foreign_file_under_a_shard_name_is_found(shard) -> None:
    shard.with_name("shard-r0-00001.mcap").write_bytes(b"not an MCAP file at all" * 100)
    report = validate(shard.parent)
    assert {defect.shard for defect in report.defects} == {"shard-r0-00001.mcap"}
    assert report.episode_count == 2


def test_forging_tool_reads_back_what_was_written(shard) -> None:
    assert [chunk.episode.index for chunk in chunks_of(shard)] == [0, 1]


DEPTH, MASK = schemas.OUTPUT_CHANNELS["depth"], schemas.OUTPUT_CHANNELS["mask"]


@pytest.fixture
def rich_shard(tmp_path):
    return write_shard(tmp_path, [0, 1], outputs=("depth", "mask"))


def test_good_dataset_with_outputs_has_no_defects(rich_shard) -> None:
    report = validate(rich_shard.parent)
    assert report.ok
    assert (report.episode_count, report.sample_count, report.notes) == (2, 24, ())


def test_rewriting_outputs_without_a_change_is_no_defect(rich_shard) -> None:
    rewrite(rich_shard, lambda records: records)
    assert validate(rich_shard.parent).ok


def test_dropped_output_is_found(rich_shard) -> None:
    rewrite(rich_shard, lambda records: [r for r in records if not (r.channel == MASK and r.sequence == 4)])
    assert "/camera/mask lacks samples 4" in texts(rich_shard.parent)


def test_episode_without_an_output_of_its_shard_is_found(rich_shard, monkeypatch) -> None:
    # The writer would refuse it.
    monkeypatch.setattr(ShardWriter, "append", _append_unchecked)
    rewrite(rich_shard, lambda records: [r for r in records if r.channel != MASK])
    assert "/camera/mask lacks samples 0, 1, 2, 3, 4 and 7 more" in texts(rich_shard.parent)


def _append_unchecked(writer, chunk, append=ShardWriter.append) -> None:
    outputs, writer.outputs = writer.outputs, tuple(chunk.outputs)
    append(writer, chunk)
    writer.outputs = outputs


def test_output_that_the_shard_has_no_channel_for_is_found(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(ShardWriter, "append", _append_unchecked)
    with ShardWriter(tmp_path / "shard-r0-00000.mcap", PROVENANCE, outputs=("depth",), fsync=False) as writer:
        header, samples = make_episode(0, outputs=("depth", "mask"))
        writer.append(encode_episode(header, 1, samples))
    assert "a message is on the unknown channel 13" in texts(tmp_path)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"no image",
        encode_output(make_images(0), "depth")[:60],
        encode_output(make_images(0, 24, 30), "depth"),
        encode_output(make_images(0), "mask"),
    ],
    ids=["none", "text", "cut", "size", "8 bit"],
)
def test_bad_output_is_found(rich_shard, data) -> None:
    def replace(records):
        at(records, DEPTH, 2).message.data = data
        return records

    rewrite(rich_shard, replace)
    assert "the depth image is damaged or has another size or format at samples 2" in texts(rich_shard.parent)


def test_output_in_another_format_than_it_says_is_found(rich_shard) -> None:
    def rename(records):
        at(records, MASK, 3).message.format = "jpeg"
        return records

    rewrite(rich_shard, rename)
    assert "the mask image is damaged or has another size or format at samples 3" in texts(rich_shard.parent)


def test_mask_of_humans_who_are_not_there_is_found(rich_shard) -> None:
    def crowd(records):
        images = dataclasses.replace(make_images(0), mask=make_images(0).mask * 2)
        at(records, MASK, 5).message.data = encode_output(images, "mask")
        return records

    rewrite(rich_shard, crowd)
    assert "the mask names humans who are not there at samples 5" in texts(rich_shard.parent)


def test_output_at_a_wrong_time_is_found(rich_shard) -> None:
    def late(records):
        at(records, DEPTH, 6).log_time_ns += 1_000_000
        at(records, MASK, 7).message.timestamp.nanos += 1
        return records

    rewrite(rich_shard, late)
    found = texts(rich_shard.parent)
    assert "/camera/depth is not at 20 Hz at samples 6" in found
    assert "/camera/mask has other stamps inside at samples 7" in found


def test_flipped_byte_in_an_output_is_found(rich_shard) -> None:
    offset = int(load_index(rich_shard).outputs["depth"]["offset"][5])
    data = bytearray(rich_shard.read_bytes())
    data[offset + 50] ^= 1
    rich_shard.write_bytes(data)
    assert {"crc", "sha256"} <= kinds(rich_shard.parent)


def test_index_with_another_place_of_an_output_is_found(rich_shard) -> None:
    index = load_index(rich_shard)
    index.outputs["mask"]["offset"][3] += 1
    write_index(index, index_path(rich_shard))
    assert kinds(rich_shard.parent) == {"index"}
    del index.outputs["mask"]
    write_index(index, index_path(rich_shard))
    assert kinds(rich_shard.parent) == {"index"}


@pytest.fixture
def labelled_shard(tmp_path):
    return write_shard(tmp_path, [0, 1], labels=True)


def test_labels_of_a_good_dataset_have_no_defects(labelled_shard) -> None:
    assert validate(labelled_shard.parent).ok


def _moved_joints(message) -> None:
    points = joints_of(message) + np.float32([0.5, 0.0, 0.0])
    message.data = labels.messages([_label(joints_m=points[0])], Timestamp(), "world", floor_m=0.0)[0].data


def _lost_joint(message) -> None:
    message.data = labels.messages([_label(joints_m=_nan_joints())], Timestamp(), "world", floor_m=0.0)[0].data


def _far_ground(message) -> None:
    ground = np.float32([[9.0, 9.0]])
    message.data = labels.messages([_label(footprint_xy_m=ground)], Timestamp(), "world", floor_m=0.0)[2].data


def _nan_joints():
    joints = make_labels(4).joints_m.copy()
    joints[7, 1] = np.nan
    return joints


def _label(**changes):
    return dataclasses.replace(make_labels(4), **changes)


def _flat_box(message) -> None:
    message.entities[0].cubes[0].size.z = 0.1


def _no_box(message) -> None:
    del message.entities[:]


def _no_stride(message) -> None:
    message.point_stride = 16


@pytest.mark.parametrize(
    ("name", "damage", "text"),
    [
        ("joints", _moved_joints, "the pelvis is not where the human is at samples 4"),
        ("joints", _moved_joints, "the box does not hold the joints at samples 4"),
        ("joints", _lost_joint, "a label is not finite at samples 4"),
        ("joints", _no_stride, "a point cloud is not packed as"),
        ("boxes", _flat_box, "the box does not hold the joints at samples 4"),
        ("boxes", _no_box, "there are boxes of 0 humans, not 1 at samples 4"),
        ("footprints", _far_ground, "the footprint is not below the human at samples 4"),
    ],
)
def test_label_that_cannot_be_is_found(labelled_shard, name, damage, text) -> None:
    def change(records):
        damage(at(records, schemas.LABEL_CHANNELS[name], 4).message)
        return records

    rewrite(labelled_shard, change)
    assert kinds(labelled_shard.parent) == {"label"}
    assert text in texts(labelled_shard.parent)


def test_label_with_another_time_inside_is_found(labelled_shard) -> None:
    def change(records):
        at(records, schemas.LABEL_CHANNELS["boxes"], 5).message.entities[0].timestamp.seconds += 1
        return records

    rewrite(labelled_shard, change)
    assert "/humans/boxes has other stamps inside at samples 5" in texts(labelled_shard.parent)
