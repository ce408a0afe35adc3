import numpy as np

from readygo.apps.coverage.numbers import Visits
from readygo.apps.coverage.page import RunFacts, coverage_page, heat_map
from readygo.common.maps import GridFrame
from tests.apps.coverage.drives import measured


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
    html = coverage_page(found, facts, heat_map(found.visits, None), np.zeros((9, 9, 3), np.uint8))
    assert "human collision" in html
    assert "&lt;plaza&gt;" in html
    # Two recorded crossings and two failed ones.
    assert "<td class=n>50 %</td>" in html
    assert "of 6 tried" in html
