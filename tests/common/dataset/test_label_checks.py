"""What must hold in the labels of recorded episodes."""

import dataclasses

import numpy as np
import pytest
from google.protobuf.timestamp_pb2 import Timestamp

from readygo.common.dataset import labels, schemas, validate
from readygo.common.dataset.labels import joints_of
from tests.common.dataset.defects import at, kinds, texts
from tests.common.dataset.episodes import (
    make_labels,
    write_shard,
)
from tests.common.dataset.forge import rewrite


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
