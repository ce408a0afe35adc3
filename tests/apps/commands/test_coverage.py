"""Coverage of datasets whose content is known."""

import dataclasses
import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.apps.commands.coverage import coverage
from readygo.apps.coverage.numbers import Histogram, Visits, casts_of, count_encounters, measure, visited_share
from readygo.apps.coverage.page import RunFacts, coverage_page, heat_map
from readygo.apps.coverage.runs import failed_encounters, rejected
from readygo.common.dataset import Dataset, ShardWriter, encode_episode, shard_name
from readygo.common.dataset.casts import Cast
from readygo.common.errors import DatasetError, RunError, SceneError
from readygo.common.maps import GridFrame, OccupancyMap, save_ros_map
from readygo.common.messages import EpisodeKey, HumanPlanRequest, Split
from readygo.services.planner import handle_human_plan
from tests.common.dataset.episodes import PROVENANCE, make_episode
from tests.services.planner.worlds import key, make_human_planner

COUNT = 20


def drive(index, *, yaw_rad, gaps_m, collision_s=math.inf, visible=0, encounters=("crossing",)):
    """An episode that drives 0.95 m from the origin at 1 m/s; people are seen at the first `visible` samples."""
    changes = {"encounters": encounters, "avatars": ("ann", "bob")[: len(encounters)]}
    header, samples = make_episode(index, COUNT, **changes)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return header, tuple(
        dataclasses.replace(
            sample,
            action_v_mps=1.0,
            action_w_radps=0.0,
            robot_xyzyaw=(0.05 * k * c + 0.01, 0.05 * k * s + 0.01, 0.0, yaw_rad),
            human_distance_m=gaps_m[k % len(gaps_m)],
            time_to_collision_s=collision_s if k == 3 else math.inf,
            human_visible=k < visible,
        )
        for k, sample in enumerate(samples)
    )


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two episodes along +x and one along +y."""
    folder = tmp_path / "data"
    folder.mkdir()
    with ShardWriter(folder / shard_name("r0", 0), PROVENANCE, fsync=False) as writer:
        for header, samples in (
            drive(0, yaw_rad=0.0, gaps_m=[2.0, 0.6, 1.0], collision_s=1.3, visible=10),
            drive(1, yaw_rad=0.0, gaps_m=[7.0], encounters=("parallel", "crossing"), visible=20),
            drive(2, yaw_rad=math.pi / 2, gaps_m=[math.inf], encounters=()),
        ):
            writer.append(encode_episode(header, 1, samples))
    return folder


@pytest.fixture
def room() -> OccupancyMap:
    """3 x 3 m around the origin, walled in."""
    occupied = np.zeros((60, 60), np.bool_)
    occupied[:2] = occupied[-2:] = occupied[:, :2] = occupied[:, -2:] = True
    return OccupancyMap(frame=GridFrame(origin_x_m=-1.0, origin_y_m=-1.0, resolution_m=0.05), occupied=occupied)


def measured(folder: Path):
    dataset = Dataset([folder])
    return measure(dataset, casts_of(dataset))


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


def test_encounters_count_episodes_and_people(data) -> None:
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


def test_heat_map_is_darkest_where_most_episodes_came_by(data, room) -> None:
    picture = heat_map(measured(data).visits, room)[:-30]
    scale = 500 / 3.8
    colours = [
        picture[round(500 - (y + 1.4) * scale), round((x + 1.4) * scale)].astype(int).sum()
        for x, y in ((0.75, 0.05), (0.05, 0.75), (0.75, 0.75))
    ]
    assert colours[0] < colours[1] < colours[2]


def test_heat_map_of_a_corridor_has_room_for_its_scale() -> None:
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1)
    picture = heat_map(Visits(frame=frame, episodes=np.ones((2000, 1), np.int64)), None)
    assert picture.shape[1] > 320


def test_files_are_complete_and_the_same_each_time(data, tmp_path, capsys) -> None:
    for name in ("a", "b"):
        coverage(data, out=tmp_path / name)
    assert "coverage.html" in capsys.readouterr().out
    for file in ("coverage.html", "coverage.json", "visits.png"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert len(list((tmp_path / "a").iterdir())) == 3


def test_json_holds_what_the_page_shows(data, tmp_path, capsys) -> None:
    coverage(data, out=tmp_path / "out", json=True)
    numbers = json.loads(capsys.readouterr().out)
    assert numbers == json.loads((tmp_path / "out" / "coverage.json").read_text())
    assert numbers["encounters"]["crossing"] == {"episodes": 2, "people": 2, "failed": None}
    assert numbers["rejected"] is numbers["visited_share"] is None
    assert numbers["scene"] == "plaza"
    assert numbers["visited_m2"] == pytest.approx(0.19)


def test_page_says_when_the_map_is_not_at_hand_and_draws_it_when_it_is_named(data, room, tmp_path) -> None:
    coverage(data, out=tmp_path / "out")
    assert "not at hand" in (tmp_path / "out" / "coverage.html").read_text()
    save_ros_map(room, tmp_path / "room.yaml")
    coverage(data, out=tmp_path / "out", scene=str(tmp_path / "room.yaml"))
    assert "not at hand" not in (tmp_path / "out" / "coverage.html").read_text()
    assert json.loads((tmp_path / "out" / "coverage.json").read_text())["visited_share"] > 0


def test_page_tells_the_experts_failures_by_encounter(data) -> None:
    found = measured(data)
    facts = RunFacts(
        name="data",
        scene="<plaza>",
        occupancy=None,
        visited_share=None,
        rejected={"human_collision": 2, "no room for a human": 1},
        failed={"crossing": {"human_collision": 2}},
    )
    html = coverage_page(found, facts, heat_map(found.visits, None))
    assert "human collision" in html
    assert "&lt;plaza&gt;" in html
    # Two recorded crossings and two failed ones.
    assert "<td class=n>50 %</td>" in html
    assert "of 6 tried" in html


def test_mistakes_leave_nothing_behind(data, tmp_path) -> None:
    with pytest.raises(DatasetError, match="does not exist"):
        coverage(tmp_path / "nowhere", out=tmp_path / "out")
    with pytest.raises(SceneError, match="cannot be read"):
        coverage(data, out=tmp_path / "out", scene=str(tmp_path / "no.yaml"))
    assert not (tmp_path / "out").exists()


def test_other_scene_than_the_datas_is_refused(data, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(
        "readygo.apps.coverage.runs.open_maps", lambda scene: (None, type("S", (), {"content_hash": "x"})())
    )
    folder = tmp_path / "hashed"
    folder.mkdir()
    with ShardWriter(folder / shard_name("r0", 0), PROVENANCE, fsync=False) as writer:
        header, samples = drive(0, yaw_rad=0.0, gaps_m=[1.0])
        writer.append(encode_episode(header, 1, samples))
    with pytest.raises(RunError, match="recorded in another scene"):
        coverage(folder, out=tmp_path / "out", scene="elsewhere")


def test_failures_are_told_by_the_scenarios_of_rejected_indices(data, monkeypatch) -> None:
    planner = make_human_planner()
    drawn = [handle_human_plan(planner, HumanPlanRequest(episode=key(k))).scenario for k in range(6)]
    kinds = {k: tuple(human.encounter for human in scenario.humans) for k, scenario in enumerate(drawn) if scenario}
    recorded, failed, *_ = sorted(kinds)
    spec = SimpleNamespace(seed=1, split=Split.TEST, static=False)
    monkeypatch.setattr("readygo.apps.coverage.runs.load_spec", lambda data: spec)
    monkeypatch.setattr("readygo.apps.coverage.runs.World", lambda spec: SimpleNamespace(human_planner=lambda: planner))
    cast = Cast(episode=key(recorded), avatars=(), encounters=kinds[recorded])
    reasons = {failed: "timeout", 99: "no room for a human"}
    assert failed_encounters(data, reasons, [cast]) == {kind: {"timeout": 1} for kind in sorted(set(kinds[failed]))}
    other = dataclasses.replace(cast, encounters=("teleport",))
    assert failed_encounters(data, reasons, [other]) is None


def test_folder_without_a_run_knows_no_failures(data) -> None:
    assert rejected(data) is None
    assert failed_encounters(data, {}, []) is None
