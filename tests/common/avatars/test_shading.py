import numpy as np
import pytest

from readygo.common.avatars import load_avatars
from readygo.common.avatars.shading import outward_normals

JOINTS = np.zeros((24, 3), dtype=np.float32)
JOINTS[4] = (0.0, -1.0, 0.0)
"""One bone down the y axis, from joint 1 to joint 4."""


def around_the_bone(count: int = 40) -> np.ndarray:
    """Points 10 cm from the bone; their outward directions are those from the axis."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([0.1 * np.cos(angle), np.full(count, -0.5), 0.1 * np.sin(angle)], axis=1)


def weights(count: int) -> np.ndarray:
    dense = np.zeros((count, 24), dtype=np.float32)
    dense[:, 1] = 1.0
    return dense


def test_discs_around_a_limb_look_outward_whichever_way_their_axes_point() -> None:
    points = around_the_bone()
    outward = points * (10.0, 0.0, 10.0)
    signs = np.where(np.arange(len(points)) % 2, 1.0, -1.0)[:, None]
    normals = outward_normals(points, outward * signs, np.ones(len(points)), weights(len(points)), JOINTS)
    assert normals == pytest.approx(outward, abs=1e-9)


def test_normals_follow_flat_gaussians_and_ignore_the_axes_of_balls() -> None:
    points = around_the_bone(1)
    tilted = np.array([[np.cos(0.6), np.sin(0.6), 0.0]])
    flat = outward_normals(points, tilted, np.ones(1), weights(1), JOINTS)
    ball = outward_normals(points, tilted, np.zeros(1), weights(1), JOINTS)
    assert ball == pytest.approx(np.array([[1.0, 0.0, 0.0]]))
    assert (flat @ tilted.T).item() > np.cos(0.15)
    assert np.linalg.norm(flat) == pytest.approx(1.0)


def test_an_axis_across_the_outward_direction_changes_nothing_abruptly() -> None:
    points = around_the_bone(1)
    both = [
        outward_normals(points, np.array([[s, np.sqrt(1 - s * s), 0.0]]), np.ones(1), weights(1), JOINTS)
        for s in (-0.01, 0.01)
    ]
    assert np.abs(both[0] - both[1]).max() < 0.1


def test_an_embedded_avatar_looks_outward_at_its_head_hands_and_back() -> None:
    avatar = load_avatars()["bruno"]
    points = avatar.cloud.means_m.astype(np.float64)
    dense = np.zeros((len(points), 24), dtype=np.float32)
    for k in range(4):
        dense[np.arange(len(points)), avatar.lbs_index[:, k]] += avatar.lbs_weight[:, k]
    count = len(points)
    normals = outward_normals(points, np.ones((count, 3)) / 3**0.5, np.zeros(count), dense, avatar.joints_canonical_m)
    top, back = points[:, 1] > points[:, 1].max() - 0.02, points[:, 2] < np.quantile(points[:, 2], 0.01)
    assert (normals[top, 1] > 0.4).all()
    assert np.mean(normals[back, 2] < -0.5) > 0.9


def test_normals_of_an_avatar_are_as_they_were(golden_figures) -> None:
    rng = np.random.default_rng(6)
    axes, joint_weights = rng.normal(size=(300, 3)), rng.random((300, 24)).astype(np.float32) ** 6
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    joint_weights /= joint_weights.sum(axis=1, keepdims=True)
    joints = rng.uniform(-1, 1, (24, 3)).astype(np.float32)
    normals = outward_normals(rng.uniform(-1, 1, (300, 3)), axes, rng.random(300), joint_weights, joints)
    golden_figures("avatars/normals", normals)
