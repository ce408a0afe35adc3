import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from readygo.apps.report.coverage import RunFacts, coverage_page, heat_map
from readygo.apps.report.coverage_numbers import Visits
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.scenes.top_view import TopView
from tests.apps.report.browser import CHROMIUM, NO_CHROMIUM, assert_readable, browser
from tests.apps.report.drives import measured


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


def test_way_through_a_large_map_is_seen() -> None:
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1)
    episodes = np.zeros((3000, 3000), np.int64)
    np.fill_diagonal(episodes, 1)
    occupancy = OccupancyMap(
        frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.5), occupied=np.zeros((976, 976), np.bool_)
    )
    picture = heat_map(Visits(frame=frame, episodes=episodes), occupancy)[:-90]
    # Without the scales; a free cell of the map is grey: all three channels alike.
    warm = np.ptp(picture.astype(int), axis=2) > 40
    across = warm[warm.any(axis=1)].sum(axis=1)
    assert across.min() >= 4, "pixels across the way"
    assert warm.any(axis=1).mean() > 0.55


def facts() -> RunFacts:
    return RunFacts(
        name="data",
        scene="<plaza>",
        occupancy=None,
        visited_share=None,
        rejected={"human_collision": 2, "no room for a human": 1},
        failed={"crossing": {"human_collision": 2}},
    )


def test_page_tells_the_experts_failures_by_encounter(data) -> None:
    found = measured(data)
    html = coverage_page(found, facts(), heat_map(found.visits, None), np.zeros((9, 9, 3), np.uint8))
    assert "human collision" in html
    assert "&lt;plaza&gt;" in html
    # Two recorded crossings and two failed ones.
    assert 'data-name="Expert succeeds">50 %</td>' in html
    assert "of 6 tried" in html


def test_page_looks_as_it_did(data, golden_page: Callable[[str, str], None]) -> None:
    found, picture = measured(data), np.zeros((9, 9, 3), np.uint8)
    golden_page("coverage", coverage_page(found, facts(), picture, picture))
    failed = {"crossing": {"timeout": 3, "human_collision": 1}, "never_seen": {"timeout": 5}}
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1)
    known = dataclasses.replace(
        facts(), failed=failed, rejected={}, visited_share=0.678, scene="", provenance={"data": "<0>"},
        occupancy=OccupancyMap(frame=frame, occupied=np.zeros((2, 2), np.bool_)),
    )  # fmt: skip
    large = dataclasses.replace(found, episodes=1234, samples=4_567_890, distance_m=98_765.4, visible_total=0.126)
    golden_page("coverage_known", coverage_page(large, known, picture, picture))
    golden_page(
        "coverage_unknown",
        coverage_page(found, dataclasses.replace(facts(), failed=None, rejected=None), picture, picture),
    )


@pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
def test_page_reads_well_on_telephones(data, tmp_path) -> None:
    found = measured(data)
    (tmp_path / "page.html").write_text(
        coverage_page(found, facts(), heat_map(found.visits, None), np.zeros((9, 9, 3), np.uint8))
    )
    with browser(tmp_path / "profile") as chromium:
        for width_px in (400, 1280):
            chromium.open(tmp_path / "page.html", width_px)
            assert_readable(chromium, width_px)
    assert chromium.complaints == []


def test_heat_map_looks_as_it_did(golden_image: Callable[[str, np.ndarray], None]) -> None:
    episodes = np.zeros((9, 14), np.int64)
    episodes[2, 1:12], episodes[2:8, 11], episodes[6, 3] = 3, 7, 1
    visits = Visits(frame=GridFrame(origin_x_m=-1.3, origin_y_m=2.1, resolution_m=0.3), episodes=episodes)
    occupied = np.ones((30, 33), np.bool_)
    occupied[3:26, 4:30] = False
    occupied[14:17, 9:14] = True
    near = OccupancyMap(frame=GridFrame(origin_x_m=-2.7, origin_y_m=0.9, resolution_m=0.2), occupied=occupied)
    golden_image("heat_map", heat_map(visits, near))
    golden_image("heat_map_alone", heat_map(visits, None))


@pytest.mark.parametrize(
    ("side_m", "visited_m", "vast"), [(60, 1.0, False), (61, 1.0, True), (80, 20.0, False), (81, 20.0, True)]
)
def test_map_is_cut_where_what_was_visited_would_be_lost(
    side_m: int, visited_m: float, vast: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown_m: list[float] = []

    def window(ground: OccupancyMap, low_m: np.ndarray, high_m: np.ndarray, *, pixel_m: float) -> TopView:
        shown_m.append(float((high_m - low_m).max()))
        return TopView(rgb=np.zeros((90, 400, 3), np.uint8), frame=ground.frame)

    monkeypatch.setattr("readygo.apps.report.coverage.map_window", window)
    frame = GridFrame(origin_x_m=90.0, origin_y_m=90.0, resolution_m=visited_m)
    around = GridFrame(origin_x_m=60.0, origin_y_m=60.0, resolution_m=1.0)
    heat_map(
        Visits(frame=frame, episodes=np.ones((1, 1), np.int64)),
        OccupancyMap(frame=around, occupied=np.zeros((side_m, 7), np.bool_)),
    )
    assert shown_m == [(visited_m if vast else side_m) + 1.0]
