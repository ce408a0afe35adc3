import dataclasses
import math
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from readygo.apps.report.coverage_numbers import Histogram, Visits, count_encounters, measure, visited_share
from readygo.common.dataset import ShardWriter, encode_episode, shard_name
from readygo.common.dataset.casts import Cast
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import EpisodeKey, Split
from readygo.common.robot import Clock, RobotConfig
from tests.apps.report.drives import COUNT, drive, measured
from tests.common.dataset.episodes import PROVENANCE

TRUTH = np.dtype([("human_visible", "?"), ("human_distance_m", "<f4"), ("time_to_collision_s", "<f4")])


class FakeData:
    """What coverage reads of a dataset: one episode of samples at rest at the origin, but for what is given."""

    def __init__(self, *, actions=None, xy_m=None):
        count = len(actions if actions is not None else xy_m)
        self.robot = RobotConfig()
        self.clock = self.robot.clock
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


def test_totals_are_those_of_the_data(data) -> None:
    found = measured(data)
    assert (found.episodes, found.samples) == (3, 60)
    assert found.distance_m == pytest.approx(3.0)
    assert found.hours == pytest.approx(60 * 0.05 / 3600)
    assert found.visible_total == pytest.approx(0.5)


def test_every_episode_counts_once_in_a_cell(data) -> None:
    visits = measured(data).visits
    assert (visits.frame.origin_x_m, visits.frame.origin_y_m) == (0.0, 0.0)
    expected = np.zeros((10, 10), np.int64)
    expected[0, :] = 2
    expected[:, 0] += 1
    assert np.array_equal(visits.episodes, expected)


def test_headings_are_counted_around_the_axes(data) -> None:
    counts = measured(data).headings.counts
    assert counts[0] == 40
    assert counts[6] == 20
    assert counts.sum() == 60


@pytest.mark.parametrize("yaw_rad", [-math.pi, -3.1, -0.01, 0.01, 3.1, math.pi])
def test_headings_wrap(tmp_path, yaw_rad) -> None:
    with ShardWriter(tmp_path / shard_name("r0", 0), PROVENANCE, fsync=False) as writer:
        writer.append(encode_episode((e := drive(0, yaw_rad=yaw_rad, gaps_m=[1.0]))[0], 1, e[1]))
    counts = measured(tmp_path).headings.counts
    assert counts[0 if abs(yaw_rad) < 1 else 12] == COUNT


def test_extremes_are_taken_once_per_episode(data) -> None:
    found = measured(data)
    assert found.closest_m.counts[2] == 1
    assert (found.closest_m.counts.sum(), found.closest_m.beyond, found.closest_m.none) == (1, 1, 1)
    assert found.closest_m.median == pytest.approx(3.8)
    assert found.collision_s.counts[5] == 1
    assert found.collision_s.none == 2
    assert found.duration_s.counts.tolist()[:2] == [3, 0]
    assert found.visible_share.counts.tolist() == [1, 0, 0, 0, 0, 1, 0, 0, 0, 1]


def test_commands_are_counted_jointly(data) -> None:
    found = measured(data)
    row, column = np.argwhere(found.actions > 0)[0]
    assert found.actions.sum() == found.actions[row, column] == 60
    # Full speed belongs to the last row, straight on to the middle column.
    assert (row, column) == (len(found.v_edges_mps) - 2, 6)


def test_encounters_count_episodes_and_humans(data) -> None:
    found = measured(data)
    assert found.encounters == {"crossing": (2, 2), "nobody": (1, 0), "parallel": (1, 1)}
    assert found.avatars == {"ann": 2, "bob": 1}
    twice = Cast(episode=EpisodeKey(seed=0, split=Split.TRAIN, index=0), avatars=("a", "b"), encounters=("x", "x"))
    assert count_encounters([twice]) == {"x": (1, 2)}


def test_histogram_bins_begin_at_their_edges() -> None:
    found = Histogram.of(np.array([-1.0, 0.0, 0.5, 1.0, 2.0, np.inf]), np.array([0.0, 0.5, 1.0, 2.0]))
    assert found.counts.tolist() == [2, 1, 1]
    assert (found.beyond, found.none, found.median) == (1, 1, 0.5)


def test_visited_share_is_of_the_reachable_ground(data, room) -> None:
    share = visited_share(measured(data).visits, room, radius_m=0.3)
    # 8 x 8 or so cells of 25 cm can be reached; 4 along each axis were, and one of these twice.
    assert share == pytest.approx(7 / 100, abs=0.01)
    shut = dataclasses.replace(room, occupied=np.ones_like(room.occupied))
    assert visited_share(measured(data).visits, shut, radius_m=0.3) == 0.0


def test_coarser_cells_have_the_count_of_their_busiest_one() -> None:
    frame = GridFrame(origin_x_m=1.0, origin_y_m=2.0, resolution_m=0.1)
    episodes = np.zeros((3, 5), np.int64)
    episodes[0, 1], episodes[1, 0], episodes[2, 4] = 2, 7, 3
    visits = Visits(frame=frame, episodes=episodes).coarser(2)
    assert visits.episodes.tolist() == [[7, 0, 0], [0, 0, 3]]
    assert (visits.frame.origin_x_m, visits.frame.origin_y_m, visits.frame.resolution_m) == (1.0, 2.0, 0.2)


@given(st.lists(st.floats(-1.0, 7.0) | st.just(math.inf) | st.sampled_from([0.0, 0.5, 1.25, 3.0]), min_size=1))
def test_histogram_counts_every_value_once(values: list[float]) -> None:
    edges = [0.0, 0.5, 1.25, 3.0]
    found = Histogram.of(np.array(values), np.array(edges))
    finite = sorted(value for value in values if value < math.inf)
    lows = [-math.inf, *edges[1:-1]]
    expected = [sum(low <= value < high for value in finite) for low, high in zip(lows, edges[1:], strict=True)]
    assert found.counts.tolist() == expected
    assert found.beyond == sum(value >= 3.0 for value in finite)
    assert found.none == len(values) - len(finite)
    assert found.median == (statistics.median(finite) if finite else None)


def test_crooked_data_are_measured_as_by_hand() -> None:
    data = FakeData(actions=[(0.37, 0.11), (-0.24, -0.9), (0.61, 1.07), (0.98, 0.0), (0.02, -0.3)])
    data.robot, data.clock = RobotConfig(v_max_mps=1.3, w_max_radps=1.1), Clock(rate_hz=40)
    data.episodes = [type("Entry", (), {"first_sample": a, "sample_count": n}) for a, n in ((0, 2), (2, 3))]
    data.episode_of_sample = np.int32([0, 0, 1, 1, 1])
    data.poses[:] = [
        (1.33, -0.71, 0, 2.5),
        (1.29, -0.64, 0, 2.6),
        (-0.2, 0.4, 0, -2.5),
        (-0.2, 0.5, 0, 0.1),
        (1.3, -0.7, 0, 7),
    ]
    data.truth["human_distance_m"] = [3.1, 2.2, 0.9, math.inf, 1.4]
    data.truth["time_to_collision_s"] = [math.inf, math.inf, 0.7, 4.9, 5.0]
    data.truth["human_visible"] = [True, True, False, True, False]
    casts = [
        Cast(episode=EpisodeKey(seed=0, split=Split.TRAIN, index=k), avatars=names, encounters=kinds)
        for k, (names, kinds) in enumerate([(("b", "a", "b"), ("x", "y", "x")), (("a",), ("y",))])
    ]
    found = measure(data, casts)
    assert (found.episodes, found.samples, found.clock.rate_hz) == (2, 5, 40)
    assert found.hours == pytest.approx(5 / 40 / 3600)
    assert found.distance_m == pytest.approx((0.37 + 0.24 + 0.61 + 0.98 + 0.02) / 40)
    assert found.visible_total == 0.6
    assert np.flatnonzero(found.visible_share.counts).tolist() == [3, 9]
    assert np.flatnonzero(found.closest_m.counts).tolist() == [3, 8]
    assert (np.flatnonzero(found.collision_s.counts).tolist(), found.collision_s.none) == ([2], 1)
    assert found.duration_s.counts[0] == 2
    assert found.duration_s.edges.tolist() == pytest.approx([2.5 * k for k in range(21)])
    assert found.v_edges_mps == pytest.approx([k / 10 for k in range(-3, 14)])
    assert found.w_edges_radps == pytest.approx([-1.1 + 2.2 * k / 13 for k in range(14)])
    rows, columns = np.nonzero(found.actions)
    fields = sorted(
        (math.floor((v + 0.3) * 10 + 1e-9), min(math.floor((w + 1.1) / 2.2 * 13), 12))
        for v, w in data.actions.astype(float).round(4).tolist()
    )
    assert list(zip(rows.tolist(), columns.tolist(), strict=True)) == fields
    width = math.tau / 24
    turns = sorted({math.floor(((yaw + width / 2) % math.tau) / width) for yaw in data.poses[:, 3].tolist()})
    assert np.flatnonzero(found.headings.counts).tolist() == turns
    assert found.headings.edges[[0, -1]] == pytest.approx([-width / 2, math.tau - width / 2])
    visits = found.visits
    assert (visits.frame.origin_x_m, visits.frame.origin_y_m) == pytest.approx((-0.2, -0.8))
    cells = {(1.33, -0.71), (1.29, -0.64), (-0.2, 0.4), (-0.2, 0.5), (1.3, -0.7)}
    wanted = {(math.floor(y * 10 + 1e-9) + 8, math.floor(x * 10 + 1e-9) + 2) for x, y in cells}
    assert set(zip(*(part.tolist() for part in np.nonzero(visits.episodes)), strict=True)) == wanted
    assert found.encounters == {"y": (2, 2), "x": (1, 2)}
    assert list(found.encounters) == ["y", "x"]
    assert list(found.avatars.items()) == [("a", 2), ("b", 1)]
