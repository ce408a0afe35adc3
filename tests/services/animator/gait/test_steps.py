import itertools

import numpy as np
import pytest

from readygo.benchmarks.motion.paths import floor, hard_stops, line
from readygo.services.animator.gait.curves import default_curves
from readygo.services.animator.gait.human import draw_style, skeleton_of
from readygo.services.animator.gait.math import Ground
from readygo.services.animator.gait.path import plan_track
from readygo.services.animator.gait.steps import OFF, ON, ROLL, SLOPE, STAND_HALF_WIDTH_M, YAW, X, Y, Z, plan_contacts
from tests.services.animator.bodies import make_avatar

SKELETON = skeleton_of(make_avatar())
STYLE = draw_style(np.random.default_rng(0), 0.0, SKELETON.size)._replace(heading_rad=0.0, toe_out_rad=0.0)


def contacts_of(xy, height=None, foot=0, cell_m=0.05):
    """Contacts of one foot along a trajectory in the z-up world; who stands looks along -y."""
    ground = floor(height, half_m=8.0, cell_m=cell_m)
    frame = ground.frame
    x, z = np.ascontiguousarray(xy[:, 0]), np.ascontiguousarray(-xy[:, 1])
    curves = default_curves()
    track = plan_track(x, z, STYLE, SKELETON.size, curves)
    place = Ground(ground.height_m, frame.origin_x_m, frame.origin_y_m, frame.resolution_m)
    return plan_contacts(track, foot, SKELETON, STYLE, place, curves)


def standing(height=None, foot=0, cell_m=0.05):
    (contact,) = contacts_of(np.zeros((40, 2)), height, foot, cell_m)
    return contact


@pytest.mark.parametrize(("foot", "side"), [(0, 1.0), (1, -1.0)])
def test_who_stands_has_the_feet_side_by_side_on_the_floor(foot, side):
    contact = standing(lambda x, y: 0.25 + 0.0 * x, foot)
    assert contact[X] == pytest.approx(side * STAND_HALF_WIDTH_M * SKELETON.size)
    assert contact[YAW] == 0.0
    assert (contact[SLOPE], contact[ROLL]) == (0.0, 0.0)
    assert contact[Y] == pytest.approx(0.25 + SKELETON.sole_m)


def test_foot_follows_the_slope_below_it_both_ways():
    contact = standing(lambda x, y: -0.2 * y + 0.1 * x)
    assert contact[SLOPE] == pytest.approx(0.2, abs=1e-5)
    assert contact[ROLL] == pytest.approx(0.1, abs=1e-5)


@pytest.mark.parametrize(("rise_m", "level"), [(0.08, False), (0.10, True), (0.4, True)])
def test_foot_across_an_edge_stands_level_on_its_upper_side(rise_m, level):
    contact = standing(lambda x, y: np.where(y < -0.05, rise_m, 0.0), cell_m=0.02)
    if level:
        assert (contact[SLOPE], contact[ROLL]) == (0.0, 0.0)
        assert contact[Y] == pytest.approx(rise_m + SKELETON.sole_m, abs=1e-5)
    else:
        assert contact[SLOPE] > 0.2
        assert contact[Y] < rise_m + SKELETON.sole_m


@pytest.mark.parametrize("speed", [0.8, 1.4])
def test_feet_step_in_turn_and_never_both_leave_the_floor_in_a_walk(speed):
    left, right = (contacts_of(line(speed), foot=foot) for foot in (0, 1))
    for contacts in (left, right):
        assert (contacts[1:, ON] - contacts[:-1, OFF] >= 0.2 - 1e-9).all()
        assert (contacts[:, OFF] > contacts[:, ON]).all()
        assert (np.diff(contacts[:, X]) > 0).all()
    both = np.sort(np.concatenate([left[1:, ON], right[1:, ON]]))
    order = [on in left[1:, ON] for on in both]
    assert all(a != b for a, b in itertools.pairwise(order))
    for time_s in np.arange(0.0, 12.0, 0.02):
        down = [((c[:, ON] <= time_s) & (time_s <= c[:, OFF])).any() for c in (left, right)]
        assert any(down), time_s


def test_every_bout_closes_with_the_feet_side_by_side():
    ends = [contacts_of(hard_stops(1.2, 3.0), foot=foot)[-1] for foot in (0, 1)]
    assert abs(ends[0][X] - ends[1][X]) < 0.02
    # Heading +x: left is +y, which is -z of the y-up world.
    assert ends[1][Z] - ends[0][Z] == pytest.approx(2 * STAND_HALF_WIDTH_M * SKELETON.size, abs=0.01)
