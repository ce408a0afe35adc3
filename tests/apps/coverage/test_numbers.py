import numpy as np
import pytest

from readygo.apps.coverage.numbers import Histogram, Visits, measure, visited_share
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.robot import RobotConfig

TRUTH = np.dtype([("human_visible", "?"), ("human_distance_m", "<f4"), ("time_to_collision_s", "<f4")])


class FakeData:
    """What coverage reads of a dataset: one episode of samples at rest at the origin, but for what is given."""

    def __init__(self, *, actions=None, xy_m=None):
        count = len(actions if actions is not None else xy_m)
        self.robot = RobotConfig()
        self.actions = np.float32(np.zeros((count, 2)) if actions is None else actions)
        self.poses = np.zeros((count, 4))
        if xy_m is not None:
            self.poses[:, :2] = xy_m
        self.truth = np.zeros(count, TRUTH)
        self.episode_of_sample = np.zeros(count, np.int32)
        self.episodes = [type("Entry", (), {"first_sample": 0, "sample_count": count})]

    def __len__(self):
        return len(self.actions)


def test_command_on_an_edge_belongs_to_the_field_above_it_though_it_is_stored_in_single_precision():
    speeds = [0.0, 0.1, 0.3, 0.6, 0.7, 0.69, 1.0]
    found = measure(FakeData(actions=[(v, 0.0) for v in speeds]), [])
    rows = found.actions.sum(axis=1)
    assert float(np.float32(0.7)) < 0.7
    assert found.v_edges_mps == pytest.approx(np.arange(11) / 10)
    assert rows.tolist() == [1, 1, 0, 1, 0, 0, 2, 1, 0, 1]


def test_turn_rates_have_a_field_for_straight_on_and_end_at_the_robots_limits():
    found = measure(FakeData(actions=[(0.5, w) for w in (-1.2, -0.05, 0.0, 0.05, 1.2)]), [])
    assert found.actions.sum(axis=0).tolist() == [1, 0, 0, 0, 0, 0, 3, 0, 0, 0, 0, 0, 1]


def test_robot_that_stays_in_a_cell_came_by_once():
    visits = measure(FakeData(xy_m=[(0.01, 0.02), (0.09, 0.02), (0.11, 0.02), (-0.01, 0.02)]), []).visits
    assert visits.episodes.tolist() == [[1, 1, 1]]
    assert (visits.frame.origin_x_m, visits.frame.origin_y_m) == pytest.approx((-0.1, 0.0))


def test_visited_share_counts_reachable_ground_only():
    occupied = np.zeros((40, 40), np.bool_)
    occupied[:, 20] = True
    occupied[:, 39] = True
    occupancy = OccupancyMap(frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1), occupied=occupied)
    everywhere = Visits(frame=occupancy.frame, episodes=np.ones((40, 40), np.int64))
    nowhere = Visits(frame=occupancy.frame, episodes=np.zeros((40, 40), np.int64))
    behind = np.zeros((40, 40), np.int64)
    behind[:, 25:35] = 1
    assert visited_share(everywhere, occupancy, 0.2) == 1.0
    assert visited_share(nowhere, occupancy, 0.2) == 0.0
    assert visited_share(Visits(frame=occupancy.frame, episodes=behind), occupancy, 0.2) == 0.0


def test_histogram_of_values_without_a_finite_one_has_no_median():
    found = Histogram.of(np.array([np.inf, np.inf]), np.array([0.0, 1.0]))
    assert (found.counts.tolist(), found.beyond, found.none, found.median) == ([0], 0, 2, None)
    assert found.to_mapping()["median"] is None
