"""What must hold in recorded episodes."""

import dataclasses

import pytest

from readygo.common.dataset import ShardWriter, encode_episode, schemas
from readygo.common.images.files import encode_output
from tests.common.dataset.defects import at, kinds, texts
from tests.common.dataset.episodes import (
    PROVENANCE,
    jpeg,
    make_episode,
    make_images,
    write_shard,
)
from tests.common.dataset.forge import rewrite


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


DEPTH, MASK = schemas.OUTPUT_CHANNELS["depth"], schemas.OUTPUT_CHANNELS["mask"]


def test_dropped_output_is_found(rich_shard) -> None:
    rewrite(rich_shard, lambda records: [r for r in records if not (r.channel == MASK and r.sequence == 4)])
    assert "/camera/mask lacks samples 4" in texts(rich_shard.parent)


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


def test_label_with_another_time_inside_is_found(tmp_path) -> None:
    labelled_shard = write_shard(tmp_path, [0, 1], labels=True)

    def change(records):
        at(records, schemas.LABEL_CHANNELS["boxes"], 5).message.entities[0].timestamp.seconds += 1
        return records

    rewrite(labelled_shard, change)
    assert "/humans/boxes has other stamps inside at samples 5" in texts(labelled_shard.parent)


def test_experts_first_commands_must_be_within_reach_from_rest(tmp_path) -> None:
    header, samples = make_episode(0)
    commands = [(sample.action_v_mps, sample.action_w_radps) for sample in samples]
    asked = [dataclasses.replace(s, expert_commands=(c, c)) for s, c in zip(samples, commands, strict=True)]
    shard = tmp_path / "shard-r0-00000.mcap"
    with ShardWriter(shard, PROVENANCE, outputs=("expert",), fsync=False) as writer:
        writer.append(encode_episode(header, 1, asked))
    assert texts(tmp_path) == ""

    def turn(records):
        at(records, schemas.EXPERT_CHANNELS["expert"], 0).message.w_radps[:] = [1.0, 1.0]
        return records

    rewrite(shard, turn)
    assert "the robot could not do what the expert would at samples 0" in texts(tmp_path)
