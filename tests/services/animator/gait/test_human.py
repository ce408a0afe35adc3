import dataclasses

import numpy as np
import pytest

from readygo.common.errors import AvatarError
from readygo.services.animator.gait.human import HEEL_PER_BALL, REFERENCE_LEG_M, TOE_PER_BALL, draw_style, skeleton_of
from tests.services.animator.bodies import CENTRE, LEFT, make_avatar


def test_measures_are_those_of_the_skeleton():
    body = skeleton_of(make_avatar())
    joints = np.array([(0.0, *CENTRE[0]), LEFT[1], LEFT[4], LEFT[7], LEFT[10]])
    hip, knee, ankle, ball = joints[1:]
    assert body.leg_m == pytest.approx(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee), abs=1e-6)
    assert body.sole_m == pytest.approx(0.081, abs=1e-6)
    assert body.toe_sole_m == pytest.approx(0.035, abs=1e-6)
    ahead = ball[2] - ankle[2]
    assert (body.heel_m, body.toe_m) == pytest.approx((HEEL_PER_BALL * ahead, TOE_PER_BALL * ahead), abs=1e-6)
    assert body.size == pytest.approx(body.leg_m / REFERENCE_LEG_M)
    assert body.offsets_m[0].tolist() == [0.0, 0.0, 0.0]
    assert body.offsets_m[4] == pytest.approx(knee - hip, abs=1e-6)


def test_measures_grow_with_the_body():
    small, tall = skeleton_of(make_avatar(scale=0.8)), skeleton_of(make_avatar(scale=1.1))
    for name in ("leg_m", "sole_m", "toe_sole_m", "heel_m", "toe_m", "size"):
        assert getattr(tall, name) / getattr(small, name) == pytest.approx(1.1 / 0.8, rel=1e-5), name


@pytest.mark.parametrize("lift_m", [-0.06, 0.2])
def test_body_whose_soles_are_not_on_the_ground_is_refused_by_name(lift_m):
    body = make_avatar("stump")
    joints = body.joints_canonical_m + np.float32([0.0, lift_m, 0.0])
    with pytest.raises(AvatarError, match=r"'stump' cannot walk: legs 0\.8\d m"):
        skeleton_of(dataclasses.replace(body, joints_canonical_m=joints))


def test_average_style_does_not_depend_on_chance_but_for_where_it_begins():
    one, other = (draw_style(np.random.default_rng(seed), 0.0, 1.0) for seed in (0, 1))
    begins = ("idle_phase_rad", "lead_left", "stride_offset", "heading_rad")
    for name in one._fields:
        assert (getattr(one, name) == getattr(other, name)) == (name not in begins), name
    assert (one.cadence, one.arm_swing, one.lean_rad) == (1.0, 1.0, 0.0)


def test_variation_scales_the_departure_and_size_the_step_width():
    average, half, whole = (draw_style(np.random.default_rng(3), variation, 1.0) for variation in (0.0, 0.5, 1.0))
    for name in ("cadence", "arm_swing", "toe_out_rad", "head_pitch_rad"):
        departures = [getattr(style, name) - getattr(average, name) for style in (half, whole)]
        assert departures[1] == pytest.approx(2.0 * departures[0])
        assert departures[1] != 0.0
    assert whole.lead_left == average.lead_left
    tall = draw_style(np.random.default_rng(3), 1.0, 1.2)
    assert tall.step_half_width_m == pytest.approx(1.2 * whole.step_half_width_m)
    assert tall.cadence == whole.cadence


def test_habits_and_measures_are_as_they_were(golden_figures):
    for variation in (0.0, 0.6, 1.0):
        habits = [draw_style(np.random.default_rng(seed), variation, 0.87) for seed in range(4)]
        golden_figures(f"gait/habits {variation}", np.array(habits), scale=20.0)
    skeleton = skeleton_of(make_avatar(scale=1.06))
    golden_figures("gait/offsets", skeleton.offsets_m, scale=20.0)
    golden_figures("gait/measures", [skeleton[1:]], scale=20.0)
