import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from readygo.services.evaluator.baselines.ellipsoids import Ellipsoids, separation

RADIUS_M = 0.3


def some_ellipsoids(count, seed=0):
    """Means [m], rotations, half axes [m], thin ones among them."""
    rng = np.random.default_rng(seed)
    half_axes = np.exp(rng.uniform(np.log(0.002), np.log(0.8), (count, 3)))
    return rng.normal(0, 0.6, (count, 3)), Rotation.random(count, random_state=seed), half_axes


def distances_m(points, mean, rotation, half_axes):
    """From points to an ellipsoid, by Lagrange's multiplier: the oracle; 0 inside."""
    v, squares = rotation.inv().apply(points - mean), half_axes**2
    low, high = np.zeros((len(v), 1)), np.linalg.norm(v, axis=1, keepdims=True) * half_axes.max() + 1.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        outside = np.square(half_axes * v / (squares + middle)).sum(axis=1, keepdims=True) > 1.0
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    apart = np.linalg.norm(v - squares * v / (squares + high), axis=1)
    return np.where((v**2 / squares).sum(axis=1) <= 1.0, 0.0, apart)


def ellipsoids_of(means, rotations, half_axes):
    quats = np.roll(rotations.as_quat(), 1, axis=1).astype(np.float32)
    return Ellipsoids(means.astype(np.float32), quats, half_axes)


def test_ball_meets_an_ellipsoid_where_it_is_nearer_than_its_radius():
    means, rotations, half_axes = some_ellipsoids(400)
    seen = {False: 0, True: 0}
    for mean, rotation, axes in zip(means, rotations, half_axes, strict=True):
        truth = distances_m(np.zeros((1, 3)), mean, rotation, axes)[0]
        if abs(truth - RADIUS_M) < 2e-3:
            continue
        offset = tuple(rotation.inv().apply(mean).tolist())
        k, _, _ = separation(offset, (0.0, 0.0, 0.0), tuple((axes**2).tolist()), RADIUS_M**2, 1.0)
        assert (k > 1.0) == (truth > RADIUS_M), (truth, k)
        seen[truth > RADIUS_M] += 1
    assert min(seen.values()) > 25


def test_segment_is_apart_where_all_of_its_points_are():
    means, rotations, half_axes = some_ellipsoids(150, seed=1)
    begin, end = np.array([-1.0, 0.3, 0.0]), np.array([0.9, -0.4, 0.2])
    seen = {False: 0, True: 0}
    for mean, rotation, axes in zip(means, rotations, half_axes, strict=True):
        points = begin + np.linspace(0, 1, 120)[:, None] * (end - begin)
        truth = distances_m(points, mean, rotation, axes).min()
        if abs(truth - RADIUS_M) < 5e-3:
            continue
        turned = rotation.inv().apply(np.stack([mean - begin, end - begin])).tolist()
        k, _, share = separation(tuple(turned[0]), tuple(turned[1]), tuple((axes**2).tolist()), RADIUS_M**2, np.inf)
        assert (k > 1.0) == (truth > RADIUS_M)
        assert 0.0 <= share <= 1.0
        seen[truth > RADIUS_M] += 1
    assert min(seen.values()) > 20


def test_cells_are_blocked_where_one_ball_of_the_stack_meets_something():
    means, rotations, half_axes = some_ellipsoids(6, seed=2)
    half_axes = half_axes * 0.4
    heights = np.stack([np.full((12, 14), 0.1), np.full((12, 14), 0.5)])
    blocked = ellipsoids_of(means, rotations, half_axes).blocked_cells(heights, (-1.4, -1.2), 0.2, RADIUS_M)
    i, j, z = np.meshgrid(np.arange(12), np.arange(14), [0.1, 0.5], indexing="ij")
    centres = np.stack([-1.4 + (j + 0.5) * 0.2, -1.2 + (i + 0.5) * 0.2, z], axis=-1).reshape(-1, 3)
    each = [distances_m(centres, *one) for one in zip(means, rotations, half_axes, strict=True)]
    truth = np.min(each, axis=0).reshape(12, 14, 2).min(axis=2)
    wrong = (blocked != (truth < RADIUS_M)) & (np.abs(truth - RADIUS_M) > 1e-3)
    assert not wrong.any()
    assert 10 < blocked.sum() < 158


def test_half_planes_hold_the_segment_and_keep_balls_apart():
    means, rotations, half_axes = some_ellipsoids(100, seed=3)
    begin, end = np.array([-0.5, 0.0, 0.1]), np.array([0.5, 0.2, 0.1])
    points = begin + np.linspace(0, 1, 40)[:, None] * (end - begin)
    rows = [
        row
        for row, (mean, rotation, axes) in enumerate(zip(means, rotations, half_axes, strict=True))
        if distances_m(points, mean, rotation, axes).min() > RADIUS_M + 0.01
    ]
    assert len(rows) > 20
    ellipsoids = ellipsoids_of(means[rows], rotations[rows], half_axes[rows])
    planes = ellipsoids.half_planes(tuple(begin), tuple(end), RADIUS_M)
    assert len(planes) == len(rows)
    assert (points[:, :2] @ planes[:, :2].T <= planes[:, 2] + 1e-6).all()
    rng = np.random.default_rng(4)
    for row, (a, b, c) in zip(rows, planes, strict=True):
        # On the border of the half-plane, wherever along it.
        along = rng.uniform(-2, 2, 5)[:, None] * np.array([-b, a]) + c * np.array([a, b])
        points = np.column_stack([along, np.full(5, 0.1)])
        assert distances_m(points, means[row], rotations[row], half_axes[row]).min() > RADIUS_M - 1e-4


def test_near_keeps_what_may_reach_a_segment():
    means = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    half_axes = np.array([[0.1, 0.1, 0.1], [0.1, 0.1, 0.1], [1.0, 0.1, 0.1]])
    near = ellipsoids_of(means, Rotation.identity(3), half_axes).near((0.0, 0.0), (1.0, 0.0), 1.5)
    assert len(near) == 2
    assert len(near.half_planes((0.0, 5.0, 0.0), (1.0, 5.0, 0.0), RADIUS_M)) == 2


@pytest.mark.parametrize("z", [0.9, -0.9])
def test_what_is_straight_above_says_nothing(z):
    ellipsoids = ellipsoids_of(np.array([[0.0, 0.0, z]]), Rotation.identity(1), np.full((1, 3), 0.1))
    assert ellipsoids.half_planes((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), RADIUS_M).shape == (0, 3)
