"""Keypoints of avatars lie where a person has them, and hidden ones have low confidences."""

import numpy as np
import pytest

from readygo.apps.avatar.capture import AvatarCaptureConfig, film_motion
from readygo.apps.avatar.keypoints import (
    HIDDEN_CONFIDENCE,
    SEEN_CONFIDENCE,
    canonical_keypoints,
    disturb_keypoints,
    keypoints_in_world,
    project_keypoints,
)
from readygo.common.avatars import Avatar, joint_positions, load_avatars
from readygo.services.reconstructor import HALPE26


@pytest.fixture(scope="module")
def person() -> Avatar:
    return load_avatars()["dae"]


def test_points_on_head_and_feet_are_in_order(person: Avatar) -> None:
    joints, places = canonical_keypoints(person)
    at = dict(zip(HALPE26, places, strict=True))
    assert at["left_ear"][0] > at["left_eye"][0] > at["nose"][0] > at["right_eye"][0] > at["right_ear"][0]
    assert at["head"][1] > at["left_eye"][1] > at["nose"][1] > at["neck"][1]
    assert at["nose"][2] > at["left_ear"][2] + 0.08
    assert at["left_small_toe"][0] > at["left_big_toe"][0] + 0.02
    assert at["left_big_toe"][2] > at["left_heel"][2] + 0.15
    assert joints[HALPE26.index("right_heel")] == 8
    assert joints[HALPE26.index("left_big_toe")] == 10


def test_joints_move_with_the_body(person: Avatar) -> None:
    motion = film_motion(person, AvatarCaptureConfig(frames=8))
    points, joints = keypoints_in_world(person, motion), joint_positions(person, motion)
    for name, joint in (("left_knee", 4), ("right_wrist", 21), ("hip", 0)):
        np.testing.assert_allclose(points[:, HALPE26.index(name)], joints[:, joint], atol=1e-4)
    nose = np.linalg.norm(points[:, 0] - joints[:, 15], axis=1)
    assert np.ptp(nose) < 1e-4


def test_hidden_points_and_those_outside_have_low_confidences() -> None:
    K, depth = np.array([[100.0, 0, 50.0], [0, 100.0, 50.0], [0, 0, 1.0]]), np.full((100, 100), np.inf, np.float32)
    depth[:, :50] = 2.0
    points = np.array([[-0.1, 0.0, 2.1], [-0.1, 0.0, 2.3], [0.1, 0.0, 9.0], [3.0, 0.0, 2.0]])
    uv, confidence = project_keypoints(points, np.eye(4), K, depth)
    np.testing.assert_allclose(uv[0], (50.0 - 100.0 * 0.1 / 2.1, 50.0))
    assert confidence.tolist() == [SEEN_CONFIDENCE, HIDDEN_CONFIDENCE, SEEN_CONFIDENCE, 0.0]


def test_errors_have_the_asked_size() -> None:
    uv, confidence = np.zeros((300, 26, 2)), np.full((300, 26), SEEN_CONFIDENCE)
    confidence[:, 13:] = HIDDEN_CONFIDENCE
    noisy = disturb_keypoints(uv, confidence, 3.0, np.random.default_rng(0)).uv_px
    assert noisy[:, :13].std() == pytest.approx(3.0, rel=0.05)
    assert noisy[:, 13:].std() == pytest.approx(6.0, rel=0.05)
