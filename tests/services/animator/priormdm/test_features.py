import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from readygo.benchmarks.motion.paths import circle, floor, reversal, s_curve, stop_and_go
from readygo.common.frames import yup_from_zup
from readygo.services.animator.gait.quality import joints_of
from readygo.services.animator.priormdm.features import (
    CONTACTS,
    FEATURE_COUNT,
    PATH,
    RIC,
    ROTATIONS,
    Start,
    decode_joints,
    decode_path,
    encode,
    encode_path,
)


@pytest.mark.parametrize("xy", [s_curve(1.2), circle(1.6), stop_and_go(1.4), reversal(1.0)], ids=lambda xy: len(xy))
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_encoded_walk_decodes_to_its_joints(animate, avatar, xy, dtype):
    _, P = joints_of(animate(xy, floor(), style=1.0), avatar)
    joints = yup_from_zup(P)
    features, start = encode(joints)
    assert features.shape == (len(P) - 1, FEATURE_COUNT)
    assert np.abs(decode_joints(features.astype(dtype), start) - joints[:-1, :22]).max() < 1e-5


@given(seed=st.integers(0, 10_000), turning=st.floats(0.0, 3.0), speed=st.floats(0.0, 5.0))
def test_path_returns_from_its_features(seed, turning, speed):
    rng = np.random.default_rng(seed)
    psi = np.cumsum(rng.normal(0.0, turning * 0.05, 600)) + rng.uniform(-20.0, 20.0)
    x, z = np.cumsum(rng.normal(0.0, 0.05 * speed, (2, 600)), axis=1) + rng.uniform(-30.0, 30.0, (2, 1))
    back = decode_path(
        np.concatenate([encode_path(x, z, psi), np.zeros((1, 3))]), Start(float(x[0]), float(z[0]), float(psi[0]))
    )
    assert np.abs(back - np.stack([x, z, psi], axis=1)).max() < 1e-9


def test_straight_walk_has_the_steps_of_its_speed_and_no_turn():
    t = np.arange(50) * 0.05
    features = encode_path(1.2 * t * np.sin(0.7), 1.2 * t * np.cos(0.7), np.full(50, 0.7))
    assert features == pytest.approx(np.tile([0.0, 0.0, 0.06], (49, 1)), abs=1e-12)


def test_turn_to_the_left_is_half_its_angle_and_negative():
    features = encode_path(np.zeros(3), np.zeros(3), np.array([0.0, 0.2, 0.3]))
    assert features[:, 0] == pytest.approx([-0.1, -0.05])


def test_features_do_not_depend_on_where_a_human_walks_and_to_where(animate, avatar):
    _, P = joints_of(animate(s_curve(1.2), floor()), avatar)
    a, _ = encode(yup_from_zup(P))
    c, s = np.cos(1.1), np.sin(1.1)
    moved = np.stack([c * P[..., 0] - s * P[..., 1] + 3.0, s * P[..., 0] + c * P[..., 1] - 7.0, P[..., 2]], axis=-1)
    b, start = encode(yup_from_zup(moved))
    assert np.abs(a - b).max() < 1e-9
    assert (start.x_m, start.z_m) == pytest.approx((moved[0, 0, 0], -moved[0, 0, 1]))


def test_rotations_are_columns_of_rotations_that_carry_the_bones(animate, avatar):
    _, P = joints_of(animate(s_curve(1.2), floor()), avatar)
    features, _ = encode(yup_from_zup(P))
    columns = features[:, ROTATIONS].reshape(-1, 21, 2, 3)
    assert np.einsum("tjai,tjbi->tjab", columns, columns) == pytest.approx(
        np.tile(np.eye(2), (len(features), 21, 1, 1))
    )


def test_standing_feet_are_in_contact_and_swinging_ones_are_not(animate, avatar):
    _, P = joints_of(animate(s_curve(1.2), floor()), avatar)
    features, _ = encode(yup_from_zup(P))
    contacts = features[:, CONTACTS]
    assert set(np.unique(contacts)) == {0.0, 1.0}
    assert (contacts[-5:] == 1.0).all()
    assert 0.4 < contacts[60:180, 1].mean() < 0.9


def test_real_sample_statistics_fit_our_walk(shared_data, animate, avatar):
    mean = np.load(shared_data / "motion" / "humanml3d" / "Mean.npy")
    std = np.load(shared_data / "motion" / "humanml3d" / "Std.npy")
    _, P = joints_of(animate(s_curve(1.2), floor()), avatar)
    joints = yup_from_zup(P)
    joints[..., 1] -= joints[..., 1].min()
    features, _ = encode(joints)
    z = (features - mean) / std
    assert np.abs(z[:, RIC].mean(axis=0)).max() < 3.0
    assert np.abs(z[1:, PATH]).max() < 6.0  # row 0 holds the jump to the smoothed heading


def test_wrong_shapes_are_worded():
    with pytest.raises(ValueError, match=r"shape \(T, 263\)"):
        decode_joints(np.zeros((4, 262)), Start(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"shape \(T \+ 1, >= 22, 3\)"):
        encode(np.zeros((1, 22, 3)))
    with pytest.raises(ValueError, match="x, z and heading of one shape"):
        encode_path(np.zeros(4), np.zeros(4), np.zeros(5))


def test_features_of_a_winding_walk_are_as_they_were(animate, avatar, golden_figures):
    _, P = joints_of(animate(s_curve(1.3), floor(), seed=5, style=1.0), avatar)
    features, start = encode(yup_from_zup(P[30:110]))
    golden_figures("priormdm/features", features)
    golden_figures("priormdm/start", [[start.x_m, start.z_m, *np.ravel(start.heading_rad)]])
    golden_figures("priormdm/joints", decode_joints(features, start).reshape(len(features), -1))
