import numpy as np
import pytest

from readygo.benchmarks.motion.paths import circle, floor, line, s_curve
from readygo.common.frames import matrix_from_axis_angle, zup_from_yup
from readygo.services.animator import skeleton_of
from readygo.services.animator.gait import walk as gait
from readygo.services.animator.gait.body import drive_of, pelvis_rotations
from readygo.services.animator.gait.curves import default_curves
from readygo.services.animator.gait.human import draw_style
from readygo.services.animator.gait.path import extend, plan_track
from readygo.services.animator.gait.quality import joints_of
from tests.services.animator.bodies import make_avatar

AVERAGE = draw_style(np.random.default_rng(0), 0.0, skeleton_of(make_avatar()).size)


@pytest.fixture
def walk_of(animate, avatar, monkeypatch):
    """Joints of somebody with given habits who walks along x, shape (T, 24, 3)."""

    def run(**habits):
        monkeypatch.setattr(gait, "draw_style", lambda *_: AVERAGE._replace(**habits))
        return joints_of(animate(line(1.2), floor()), avatar)[1][40:160]

    return run


def test_who_leans_carries_the_shoulders_further_ahead(walk_of):
    def lean_rad(**habits):
        P = walk_of(**habits)
        trunk = P[:, 12] - P[:, 0]
        return np.arctan2(trunk[:, 0], trunk[:, 2]).mean()

    assert lean_rad(lean_rad=0.1) - lean_rad() == pytest.approx(0.1, abs=0.03)


def test_arms_swing_by_the_factor_of_the_human(walk_of):
    def swing_m(**habits):
        P = walk_of(**habits)
        return np.ptp(P[:, 20, 0] - P[:, 16, 0])

    assert swing_m(arm_swing=1.3) > 1.15 * swing_m()
    assert swing_m(arm_swing=0.7) < 0.85 * swing_m()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_pelvis_and_trunk_lean_into_a_turn(animate, avatar, side):
    """By half of, and by the whole of 0.6 of the slope that the centripetal acceleration asks for."""
    xy = circle(1.3, 1.4) * [1.0, side]
    motion = animate(xy, floor())
    steps = slice(40, 160)
    inwards = -xy[steps] / np.hypot(*xy[steps].T)[:, None]
    up = zup_from_yup(matrix_from_axis_angle(motion.pose_axis_angle[steps, 0])[:, :, 1])
    bank_rad = 0.6 * 1.3**2 / 1.4 / 9.81
    assert np.mean((up[:, :2] * inwards).sum(axis=1)) == pytest.approx(0.5 * bank_rad, abs=0.006)
    P = joints_of(motion, avatar)[1][steps]
    trunk = (P[:, 12] - P[:, 3]) / np.linalg.norm(P[:, 12] - P[:, 3], axis=1, keepdims=True)
    assert np.mean((trunk[:, :2] * inwards).sum(axis=1)) == pytest.approx(0.8 * bank_rad, abs=0.015)


def test_body_of_someone_who_walks_the_mirrored_path_mirrors_in_the_mean(animate):
    """Sums over strides: forward pitch stays, leans to the sides and turns change sides."""
    left, right = (animate(circle(1.1, 1.6) * [1.0, side], floor()) for side in (1.0, -1.0))
    means = [motion.pose_axis_angle[45:165].mean(axis=0) for motion in (left, right)]
    for joint in (3, 6, 9, 12, 15):
        assert means[0][joint] == pytest.approx(means[1][joint] * [1.0, -1.0, -1.0], abs=0.012)
    for joint in (1, 4, 7, 13, 16, 18, 20):
        assert means[0][joint] == pytest.approx(means[1][joint + 1] * [1.0, -1.0, -1.0], abs=0.03)


def test_drive_signals_and_pelvis_are_as_they_were(golden_figures):
    """Of a track that curves, speeds up and stops: bank, lean, look, shift and the body's channels."""
    curves, style = default_curves(), draw_style(np.random.default_rng(4), 1.0, 0.9)
    xy = np.vstack([s_curve(1.3)[:90], s_curve(1.3)[90:91].repeat(40, axis=0)])
    x, z, _ = extend(np.ascontiguousarray(xy), style, 0.9, 1.5)
    track = plan_track(x, z, style, 0.9, curves)
    drive = drive_of(track, style, 0.9, curves)
    signals = (drive.walk, drive.stand, drive.run, drive.body, 9.0 * drive.lean, 9.0 * drive.bank, drive.look)
    golden_figures("gait/drive signals", *signals, drive.shift)
    golden_figures("gait/pelvis", pelvis_rotations(track, drive, style))
