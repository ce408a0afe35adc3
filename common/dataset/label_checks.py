"""What must hold in the labels of one sample."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array, Float64Array
from readygo.common.dataset.labels import boxes_of, footprints_of, joints_of
from readygo.common.errors import DatasetError

ROOT_TOLERANCE_M = 1e-3
"""Joints are single precision, poses double."""
BODY_REACH_M = 2.0
"""Nothing of a body is further from its pelvis."""
BOX_MARGIN_M = 0.15
"""Joints of the fingers and soft clothes may lie this far outside of a box of the solid parts."""


def wrong_labels(humans: Any, joints: Any, boxes: Any, footprints: Any) -> Iterator[str]:
    """What does not hold in the messages of one sample on /humans and on the channels of the labels."""
    try:
        joints_m, boxes_m, ground_m = joints_of(joints), boxes_of(boxes), footprints_of(footprints)
    except DatasetError as error:
        yield str(error)
        return
    count = len(humans.poses)
    for name, labels in (("joints", joints_m), ("boxes", boxes_m), ("footprints", ground_m)):
        if len(labels) != count:
            yield f"there are {name} of {len(labels)} humans, not {count}"
            return
    arrays: tuple[AnyArray, ...] = (joints_m, boxes_m, *ground_m)
    if not all(np.isfinite(array).all() for array in arrays):
        yield "a label is not finite"
        return
    for k, human in enumerate(humans.poses):
        here_m = np.array([human.position.x, human.position.y])
        if np.linalg.norm(joints_m[k, 0, :2] - here_m) > ROOT_TOLERANCE_M:
            yield "the pelvis is not where the human is"
        if not _box_holds(boxes_m[k], joints_m[k]):
            yield "the box does not hold the joints"
        if len(ground_m[k]) == 0 or np.abs(ground_m[k] - here_m).max() > BODY_REACH_M:
            yield "the footprint is not below the human"


def _box_holds(box: Float64Array, joints_m: Float32Array) -> bool:
    """True if the box is as large as a human at most, and all joints are in it or close."""
    size_m, yaw_rad = box[3:6], box[6]
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    offset = joints_m - box[:3]
    in_box = np.stack([c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0], offset[:, 2]], axis=1)
    inside = np.abs(in_box) <= 0.5 * size_m + BOX_MARGIN_M
    return bool(inside.all() and (size_m > 0.0).all() and size_m.max() <= 2 * BODY_REACH_M)
