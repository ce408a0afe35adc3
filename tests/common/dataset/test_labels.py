import math

import numpy as np
import pytest
from google.protobuf.timestamp_pb2 import Timestamp

from readygo.common.dataset.labels import boxes_of, footprints_of, joints_of, messages
from readygo.common.errors import DatasetError
from readygo.common.messages.samples import HumanLabels
from tests.common.dataset.episodes import make_labels

STAMP = Timestamp(seconds=3)


def two_humans() -> list[HumanLabels]:
    rng = np.random.default_rng(0)
    other = HumanLabels(
        joints_m=rng.normal(size=(24, 3)).astype(np.float32),
        box=np.array([1.0, -2.0, 0.9, 0.5, 0.7, 1.8, -2.5]),
        footprint_xy_m=rng.normal(size=(7, 2)).astype(np.float32),
    )
    return [make_labels(4), other]


def test_labels_come_back_as_they_went_in() -> None:
    humans = two_humans()
    joints, boxes, footprints = messages(humans, STAMP, "world", floor_m=0.5)
    np.testing.assert_array_equal(joints_of(joints), [label.joints_m for label in humans])
    np.testing.assert_allclose(boxes_of(boxes), [label.box for label in humans], atol=1e-15)
    found = footprints_of(footprints)
    assert len(found) == 2
    for ground, label in zip(found, humans, strict=True):
        np.testing.assert_array_equal(ground, label.footprint_xy_m)


def test_viewers_find_frames_times_and_layout() -> None:
    joints, boxes, footprints = messages(two_humans(), STAMP, "world", floor_m=0.5)
    assert [(f.name, f.offset) for f in joints.fields] == [("x", 0), ("y", 4), ("z", 8), ("human", 12)]
    assert [(f.name, f.offset) for f in footprints.fields] == [("x", 0), ("y", 4), ("human", 8)]
    assert (joints.point_stride, len(joints.data)) == (13, 2 * 24 * 13)
    assert (joints.pose.position.z, footprints.pose.position.z) == (0.0, 0.5)
    for part in (joints, footprints, *boxes.entities):
        assert (part.frame_id, part.timestamp) == ("world", STAMP)
    assert [entity.id for entity in boxes.entities] == ["0", "1"]
    assert boxes.entities[0].cubes[0].size.z == 1.8


def test_one_human_takes_less_than_a_kilobyte_beside_the_ground_points() -> None:
    label = make_labels(0)
    sizes = [message.ByteSize() for message in messages([label], STAMP, "world", floor_m=0.0)]
    assert sum(sizes) - label.footprint_xy_m.nbytes < 1000


def test_nobody_has_no_labels() -> None:
    joints, boxes, footprints = messages([], STAMP, "world", floor_m=0.0)
    assert joints_of(joints).shape == (0, 24, 3)
    assert boxes_of(boxes).shape == (0, 7)
    assert footprints_of(footprints) == ()


def test_yaw_of_a_box_comes_back_within_half_a_turn() -> None:
    label = HumanLabels(
        joints_m=make_labels(0).joints_m,
        box=np.array([0.0, 0.0, 0.9, 0.5, 0.7, 1.8, 1.5 * math.pi]),
        footprint_xy_m=np.zeros((1, 2), np.float32),
    )
    assert boxes_of(messages([label], STAMP, "world", floor_m=0.0)[1])[0, 6] == pytest.approx(-0.5 * math.pi)


def test_other_layouts_are_refused() -> None:
    joints, boxes, footprints = messages(two_humans(), STAMP, "world", floor_m=0.0)
    with pytest.raises(DatasetError, match="not packed as"):
        joints_of(footprints)
    joints.data = joints.data[: 13 * 30]
    with pytest.raises(DatasetError, match="not 24 joints for everybody"):
        joints_of(joints)
    footprints.data += b"x"
    with pytest.raises(DatasetError, match="not packed as"):
        footprints_of(footprints)
    del boxes.entities[0]
    with pytest.raises(DatasetError, match="not one cube for everybody"):
        boxes_of(boxes)
