import numpy as np
import pytest

from readygo.benchmarks.motion.paths import floor, line
from readygo.common.frames import yup_from_zup
from readygo.services.animator import skeleton_of
from readygo.services.animator.gait.math import Ground
from readygo.services.animator.gait.quality import joints_of
from readygo.services.animator.priormdm.placement import wear
from readygo.services.animator.smpl.fit import fit_rotations

FLAT = floor()
GROUND = Ground(FLAT.height_m, FLAT.frame.origin_x_m, FLAT.frame.origin_y_m, FLAT.frame.resolution_m)


@pytest.fixture(scope="module")
def standing(animate, avatar):
    """Joints 0..21 of a person who stands still for two seconds, balls of the feet at y = 0."""
    _, P = joints_of(animate(0.0 * line(1.0, 2.0), FLAT), avatar)
    joints = yup_from_zup(np.repeat(P[:1, :22], 40, axis=0))
    joints[..., 1] -= skeleton_of(avatar).toe_sole_m
    return joints


def worn(joints, avatar):
    """Positions of the body's joints over the flat floor."""
    skeleton = skeleton_of(avatar)
    G, pelvis = wear(joints, skeleton, GROUND)
    X = np.empty((len(G), 24, 3))
    X[:, 0] = pelvis
    for joint, parent in enumerate([0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8]):
        if joint:
            X[:, joint] = X[:, parent] + G[:, parent] @ skeleton.offsets_m[joint]
    return G, X


def test_stand_stays_as_it_is(standing, avatar):
    skeleton = skeleton_of(avatar)
    _, X = worn(standing, avatar)
    expected = standing[:, :12] + (0.0, skeleton.toe_sole_m, 0.0)
    assert np.abs(X[:, :12] - expected).max() < 1e-3


def test_ball_that_slides_slowly_is_held_and_one_that_steps_is_not(standing, avatar):
    slow, quick = standing.copy(), standing.copy()
    wave = np.sin(np.arange(40) * 0.05 * 2.0)
    slow[:, [7, 10], 0] += 0.02 * wave[:, None]
    quick[:, [7, 10], 2] += 0.4 * np.sin(np.arange(40) * 0.5)[:, None]
    assert np.ptp(worn(slow, avatar)[1][:, 10], axis=0).max() < 2e-3
    assert np.ptp(worn(quick, avatar)[1][:, 10, 2]) > 0.5


def test_pelvis_sinks_for_a_foot_that_is_too_far_and_keeps_its_place(standing, avatar):
    far = standing.copy()
    far[15:25, [8, 11], 2] += 0.45
    _, X = worn(far, avatar)
    assert X[20, 0, 1] < X[0, 0, 1] - 0.05
    assert np.abs(X[:, 0, [0, 2]] - standing[:, 0, [0, 2]]).max() == 0.0
    assert np.abs(np.diff(X[:, 0, 1])).max() < 0.06
    assert X[20, 8] == pytest.approx(far[20, 8] + (0.0, skeleton_of(avatar).toe_sole_m, 0.0), abs=0.01)


def test_feet_below_the_floor_are_put_on_it(standing, avatar):
    sunk = standing.copy()
    sunk[:, [7, 8, 10, 11], 1] -= 0.05
    _, X = worn(sunk, avatar)
    skeleton = skeleton_of(avatar)
    assert X[:, 7:9, 1].min() > skeleton.sole_m - 1e-3
    assert X[:, 10:12, 1].min() > skeleton.toe_sole_m - 2e-3


def test_toes_bend_where_a_heel_is_off_the_floor(standing, avatar):
    raised = standing.copy()
    raised[:, 7, 1] += 0.06
    raised[:, 7, 2] += 0.02
    G, X = worn(raised, avatar)
    skeleton = skeleton_of(avatar)
    toes = skeleton.toe_m - 0.5 * (skeleton.offsets_m[10, 2] + skeleton.offsets_m[11, 2])
    tip = X[:, 10] + G[:, 10] @ np.array([0.0, -skeleton.toe_sole_m, toes])
    stiff = X[:, 10] + G[:, 7] @ np.array([0.0, -skeleton.toe_sole_m, toes])
    assert stiff[:, 1].max() < -0.003
    assert tip[:, 1].min() > -1e-4
    flat, _ = fit_rotations(raised, skeleton.offsets_m, retarget=True)
    assert np.abs(flat[:, 10] - flat[:, 7]).max() == 0.0


def test_steps_on_uneven_ground_are_worn_as_they_were(animate, avatar, golden_figures):
    ground = floor(lambda x, y: 0.05 * np.sin(2.3 * x) + 0.04 * y)
    _, P = joints_of(animate(line(1.1, 3.0), ground, seed=3, style=1.0), avatar)
    joints = yup_from_zup(P[:60, :22]) + np.random.default_rng(2).normal(0.0, 0.006, (60, 22, 3))
    joints[..., 1] -= joints[..., 1].min()
    frame = ground.frame
    G, pelvis = wear(
        joints, skeleton_of(avatar), Ground(ground.height_m, frame.origin_x_m, frame.origin_y_m, frame.resolution_m)
    )
    golden_figures("priormdm/worn", G.reshape(60, -1), 5.0 * pelvis)
