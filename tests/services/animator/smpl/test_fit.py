import dataclasses

import numpy as np
import pytest

from readygo.benchmarks.motion.paths import circle, floor, reversal, s_curve, stop_and_go
from readygo.common.frames import yup_from_zup
from readygo.services.animator import skeleton_of
from readygo.services.animator.gait.quality import joints_of
from readygo.services.animator.smpl.fit import fit_rotations, pose_of
from readygo.services.animator.smpl.fit_math import turn
from tests.services.animator.bodies import make_avatar, spins_radps
from tests.services.animator.smpl.fitted import fit_motion

PATHS = {"s_curve": s_curve(1.2), "circle": circle(1.6), "stop_and_go": stop_and_go(1.4), "reversal": reversal(1.0)}


def with_elbows_and_knees(bends_rad):
    """A body in T-pose with joints bent, y-up: joints (T, 24, 3) and its offsets."""
    offsets = skeleton_of(make_avatar()).offsets_m
    P = np.zeros((len(bends_rad), 24, 3))
    for row, bend in enumerate(bends_rad):
        G = np.tile(np.eye(3), (24, 1, 1))
        for elbow, side in ((18, 1.0), (19, -1.0)):
            G[[elbow, elbow + 2, elbow + 4]] = turn(np.array([0.0, -side, 0.0]), bend)
        for knee in (4, 5):
            G[[knee, knee + 3, knee + 6]] = turn(np.array([1.0, 0.0, 0.0]), bend)
        for joint, parent in enumerate(
            [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
        ):
            if parent >= 0:
                P[row, joint] = P[row, parent] + G[parent] @ offsets[joint]
    return P, offsets


@pytest.mark.parametrize("count", [22, 24])
@pytest.mark.parametrize("name", PATHS)
def test_fit_of_a_walk_puts_every_joint_back(animate, avatar, name, count):
    walked = animate(PATHS[name], floor(), style=1.0)
    G, P = joints_of(walked, avatar)
    fitted = fit_motion(P[:, :count], skeleton_of(avatar).offsets_m)
    H, Q = joints_of(fitted, avatar)
    error_m = np.sqrt(np.sum((Q - P)[:, :count] ** 2, axis=2))
    assert error_m.mean() < 1e-4
    assert error_m.max() < 1e-3
    assert (spins_radps(H) < 1.5 * spins_radps(G) + 0.5).all()


def test_bent_limbs_turn_about_their_hinges_and_hardly_twist():
    P, offsets = with_elbows_and_knees(np.full(12, 1.2))
    G, _ = fit_rotations(P, offsets)
    for upper, lower, axis in ((16, 18, 1), (17, 19, 1), (1, 4, 0), (2, 5, 0)):
        local = G[5, upper].T @ G[5, lower]
        assert abs(local[axis, axis]) > 0.96
        assert np.trace(G[5, upper]) > 1.0 + 2.0 * np.cos(0.15)


def test_straightening_limbs_never_flip():
    P, offsets = with_elbows_and_knees(np.concatenate([np.linspace(0.6, 0.0, 20), np.linspace(0.0, 0.6, 20)]))
    P += np.random.default_rng(3).normal(0.0, 0.002, P.shape)
    G, _ = fit_rotations(P, offsets)
    assert spins_radps(G)[[1, 2, 16, 17]].max() < 6.0


def test_other_body_keeps_directions_of_arms_and_reaches_for_the_ankles(animate, avatar):
    _, P = joints_of(animate(s_curve(1.2), floor()), avatar)
    yup = yup_from_zup(P)
    other = skeleton_of(avatar).offsets_m * 1.06
    _, X = fit_rotations(yup[:, :22], other, retarget=True)
    for elbow, wrist in ((18, 20), (19, 21)):
        ours, theirs = X[:, wrist] - X[:, elbow], yup[:, wrist] - yup[:, elbow]
        assert np.sum(ours * theirs, axis=1) == pytest.approx(1.06 * np.sum(theirs * theirs, axis=1), rel=1e-6)
    assert np.abs(X[:, 7:9] - yup[:, 7:9]).max() < 0.02


def test_degenerate_joints_give_finite_rotations():
    offsets = skeleton_of(make_avatar()).offsets_m
    G, X = fit_rotations(np.zeros((3, 22, 3)), offsets)
    assert np.isfinite(G).all()
    assert np.isfinite(X).all()
    assert np.einsum("tjki,tjkl->tjil", G, G) == pytest.approx(np.tile(np.eye(3), (3, 24, 1, 1)), abs=1e-9)


def test_wrong_input_is_worded(avatar):
    offsets = skeleton_of(avatar).offsets_m
    with pytest.raises(ValueError, match=r"shape \(T, 22 or 24, 3\).*got \(5, 23, 3\)"):
        fit_rotations(np.zeros((5, 23, 3)), offsets)
    broken = np.zeros((5, 22, 3))
    broken[3, 4, 1] = np.nan
    with pytest.raises(ValueError, match="row 3 is not"):
        fit_rotations(broken, offsets)


def test_fit_is_the_same_for_read_only_and_strided_joints(animate, avatar):
    _, P = joints_of(animate(s_curve(1.2), floor()), avatar)
    offsets = skeleton_of(avatar).offsets_m
    frozen = P.copy()
    frozen.flags.writeable = False
    strided = np.asfortranarray(P)
    a, b, c = (fit_motion(joints, offsets) for joints in (P, frozen, strided))
    assert dataclasses.astuple(a)[1].tobytes() == b.pose_axis_angle.tobytes() == c.pose_axis_angle.tobytes()


def test_fits_are_as_they_were(animate, avatar, golden_figures):
    _, P = joints_of(animate(s_curve(1.2), floor(), style=1.0, seed=2), avatar)
    P = P[40:90] + np.random.default_rng(4).normal(0.0, 0.004, (50, 24, 3))
    offsets = skeleton_of(avatar).offsets_m
    for name, joints, retarget in (("all", P, False), ("22", P[:, :22], False), ("other body", P[:, :22], True)):
        G, X = fit_rotations(yup_from_zup(joints), offsets * (1.04 if retarget else 1.0), retarget=retarget)
        golden_figures(f"smpl/rotations {name}", G.reshape(50, -1))
        golden_figures(f"smpl/joints {name}", X.reshape(50, -1))
        golden_figures(f"smpl/pose {name}", pose_of(G).reshape(50, -1))
