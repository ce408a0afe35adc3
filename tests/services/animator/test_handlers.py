import dataclasses
import re

import numpy as np
import pytest

from readygo.benchmarks.motion.paths import circle, floor, line
from readygo.common.errors import AvatarError, MotionError
from readygo.common.maps.grid import GridFrame, OccupancyMap
from readygo.common.messages import (
    AnimateRequest,
    EpisodeKey,
    HumanTrajectory,
    Scenario,
    Split,
)
from readygo.services.animator import Animator, AnimatorConfig, handle_animate
from readygo.services.animator.handlers import check_free
from tests.services.animator.bodies import make_avatar


def human(avatar, xy):
    return HumanTrajectory(avatar=avatar, encounter="crossing", speed_mps=1.0, xy_m=xy)


def scenario(*humans, index=5):
    return Scenario(
        episode=EpisodeKey(seed=1, split=Split.TRAIN, index=index),
        start_xyyaw=np.zeros(3),
        goal_xy_m=np.ones(2),
        humans=humans,
    )


@pytest.fixture(scope="module")
def animator():
    return Animator({"ada": make_avatar("ada"), "bob": make_avatar("bob", 1.1)}, floor(), AnimatorConfig())


def test_every_human_gets_a_motion_in_order(animator):
    reply = handle_animate(
        animator, AnimateRequest(scenario=scenario(human("bob", line(1.0)), human("ada", circle(0.9))))
    )
    assert reply.rejected == ""
    assert [person.avatar for person in reply.motions.humans] == ["bob", "ada"]
    assert reply.motions.humans[1].motion.root_m[50, :2] == pytest.approx(circle(0.9)[50], abs=0.02)


def test_scenario_without_humans_has_no_motions(animator):
    assert handle_animate(animator, AnimateRequest(scenario=scenario())).motions.humans == ()


def test_motion_depends_on_the_episode_and_on_no_other_human(animator):
    def second(first, index=5):
        request = AnimateRequest(scenario=scenario(human("bob", first), human("ada", line(1.0)), index=index))
        return handle_animate(animator, request).motions.humans[1].motion.pose_axis_angle

    assert np.array_equal(second(line(1.0)), second(circle(0.5)))
    assert not np.array_equal(second(line(1.0)), second(line(1.0), index=6))


def test_impossible_trajectory_rejects_the_episode(animator):
    xy = line(1.0)
    xy[9] = np.nan
    reply = handle_animate(animator, AnimateRequest(scenario=scenario(human("ada", xy))))
    assert reply.motions is None
    assert reply.rejected.startswith("motion: Row 9")
    assert "\n" not in reply.rejected


def blocked(row=slice(None), column=150):
    """A map of 30 m by 30 m at 0.1 m with a wall, 0.1 m thick, along x = 0.05."""
    occupied = np.zeros((300, 300), dtype=bool)
    occupied[row, column] = True
    frame = GridFrame(origin_x_m=-15.0, origin_y_m=-15.0, resolution_m=0.1)
    return OccupancyMap(frame=frame, occupied=occupied)


@pytest.mark.parametrize("speed", [0.6, 3.4])
def test_trajectory_through_a_wall_rejects_the_episode(speed):
    walls = Animator({"ada": make_avatar("ada")}, floor(), AnimatorConfig(), obstacles=blocked())
    xy = line(speed, 4.0)
    reply = handle_animate(walls, AnimateRequest(scenario=scenario(human("ada", xy))))
    assert reply.motions is None
    assert reply.rejected.startswith("motion: The trajectory leads through an obstacle at (0.0")
    beside = Animator({"ada": make_avatar("ada")}, floor(), AnimatorConfig(), obstacles=blocked(slice(0, 140)))
    assert handle_animate(beside, AnimateRequest(scenario=scenario(human("ada", xy)))).rejected == ""


def test_trajectory_that_leaves_the_map_rejects_the_episode():
    walls = Animator({"ada": make_avatar("ada")}, floor(), AnimatorConfig(), obstacles=blocked(slice(0, 1)))
    reply = handle_animate(walls, AnimateRequest(scenario=scenario(human("ada", line(1.0) + np.array([12.0, 0.0])))))
    assert "(15.0" in reply.rejected


def test_unknown_avatar_is_named(animator):
    with pytest.raises(AvatarError, match=r"'zoe' of episode train-1-000005 .* loaded: ada, bob"):
        handle_animate(animator, AnimateRequest(scenario=scenario(human("zoe", line(1.0)))))


def test_avatar_that_cannot_stand_is_refused():
    body = make_avatar("stump")
    joints = body.joints_canonical_m.copy()
    joints[:, 1] += 1.0
    with pytest.raises(AvatarError, match="'stump' cannot walk"):
        Animator({"stump": dataclasses.replace(body, joints_canonical_m=joints)}, floor(), AnimatorConfig())


def test_trajectory_is_refused_at_its_first_point_in_an_obstacle():
    """Random steps on an oblong map off the origin; points lie half a cell apart or nearer."""
    rng = np.random.default_rng(4)
    occupied = rng.random((23, 41)) < 0.04
    obstacles = OccupancyMap(frame=GridFrame(origin_x_m=-2.3, origin_y_m=4.1, resolution_m=0.13), occupied=occupied)
    found = []
    for start in rng.uniform((-2.1, 4.3), (2.8, 6.9), (80, 2)):
        xy = start + np.vstack([np.zeros(2), np.cumsum(rng.normal(0.0, 0.2, (4, 2)), axis=0)])
        parts = int(np.ceil(2.0 * np.abs(np.diff(xy, axis=0)).max() / 0.13))
        points = [(xy[k] + n / parts * (xy[min(k + 1, 4)] - xy[k]), k) for k in range(5) for n in range(parts)]
        blocked = []
        for (x_m, y_m), row in points:
            i, j = obstacles.frame.cell(x_m, y_m)
            if not (0 <= i < 23 and 0 <= j < 41) or occupied[i, j]:
                blocked.append(f"({x_m:.2f}, {y_m:.2f}) m, row {row};")
        found.append(bool(blocked))
        if blocked:
            with pytest.raises(MotionError, match=re.escape(blocked[0])):
                check_free(obstacles, xy)
        else:
            check_free(obstacles, xy)
    assert 10 < sum(found) < 70
