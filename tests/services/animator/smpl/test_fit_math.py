import numpy as np
import pytest

from readygo.services.animator.smpl.fit_math import across, aim, align, cross, swing, turn, twist_about, unit


def test_align_finds_the_rotation_of_points_in_a_plane():
    rng = np.random.default_rng(0)
    for _ in range(20):
        source = np.concatenate([rng.standard_normal((3, 2)), np.zeros((3, 1))], axis=1)
        R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        R *= np.sign(np.linalg.det(R))
        assert align(source, source @ R.T, np.ones(3)) == pytest.approx(R, abs=1e-9)


def test_swing_to_the_opposite_direction_is_a_rotation():
    bone = np.array([0.0, -0.4, 0.0])
    R = swing(np.eye(3), bone, np.array([0.0, 1.0, 0.0]))
    assert R @ bone == pytest.approx([0.0, 0.4, 0.0], abs=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_turn_is_right_handed_about_its_axis():
    z = np.array([0.0, 0.0, 1.0])
    assert turn(z, np.pi / 2) @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0])
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    R = turn(axis, 0.7)
    assert R @ axis == pytest.approx(axis)
    assert np.trace(R) == pytest.approx(1.0 + 2.0 * np.cos(0.7))


def test_swing_is_the_shortest_turn_of_the_bone():
    G, bone, direction = turn(np.array([0.0, 1.0, 0.0]), 0.4), np.array([0.0, -0.4, 0.1]), np.array([0.6, 0.0, 0.8])
    R = swing(G, bone, direction)
    assert R @ bone == pytest.approx(np.linalg.norm(bone) * direction)
    cosine = (G @ bone) @ direction / np.linalg.norm(bone)
    assert np.trace(R @ G.T) == pytest.approx(1.0 + 2.0 * cosine)
    assert swing(G, np.zeros(3), direction) == pytest.approx(G)


def test_aim_takes_bone_to_direction_and_hinge_near_the_normal():
    bone, hinge = np.array([0.3, 0.0, 0.0]), np.array([0.1, 0.0, 1.0])
    direction, normal = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.5, 0.0])
    R = aim(bone, hinge, direction, normal)
    assert R @ bone == pytest.approx(0.3 * direction)
    assert pytest.approx([1.0, 0.0, 0.0]) == R @ [0.0, 0.0, 1.0]
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize("angle_rad", [-3.0, -0.2, 0.0, 1.3, 3.1])
def test_twist_is_the_turn_about_the_axis_whatever_the_swing(angle_rad):
    axis = np.array([0.0, 0.6, 0.8])
    assert twist_about(turn(axis, angle_rad), axis) == pytest.approx(angle_rad)
    swung = turn(np.array([1.0, 0.0, 0.0]), 0.9) @ turn(axis, angle_rad)
    assert twist_about(swung, axis) == pytest.approx(angle_rad)


def test_vectors_have_length_one_or_the_fallbacks():
    fallback = np.array([0.0, 0.0, 1.0])
    assert unit(np.array([3.0, 4.0, 0.0]), fallback) == pytest.approx([0.6, 0.8, 0.0])
    assert unit(np.zeros(3), fallback) == pytest.approx(fallback)
    assert cross(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])) == pytest.approx(fallback)
    assert across(np.array([1.0, 2.0, 3.0]), fallback) == pytest.approx([1.0, 2.0, 0.0])
