"""The demo's report: one HTML file, complete, escaped, without a network."""

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.pictures.film import write_film
from readygo.apps.report.learn import Ends, ReportContent, RunNumbers, report_html, write_report
from readygo.apps.report.page import CommandLine, PageLink, StripImage, film
from readygo.apps.report.tables import DriverScore
from readygo.common.drawing.charts import Curve
from readygo.common.drawing.plan_view import GOAL, ROBOT, DrawnEpisode, draw_episodes, map_view, resize_view
from readygo.common.episode.metrics import EpisodeResult, summarize
from readygo.common.errors import ReadygoError
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages.plan import Outcome
from readygo.common.scenes.top_view import TopView
from tests.apps.report.browser import CHROMIUM, NO_CHROMIUM, assert_films_play, assert_readable, browser

VOID = {"meta", "img", "br", "line", "rect", "circle", "polyline"}


def summary(successes: int, count: int):
    results = [
        EpisodeResult(
            outcome=Outcome.SUCCESS if k < successes else Outcome.HUMAN_COLLISION,
            duration_s=12.5,
            path_length_m=5.0,
            shortest_m=4.0,
        )
        for k in range(count)
    ]
    return summarize(results, time_limit_s=50.0)


def occupancy() -> OccupancyMap:
    occupied = np.zeros((40, 60), dtype=np.bool_)
    occupied[0] = occupied[-1] = True
    occupied[:5, :5] = True
    return OccupancyMap(frame=GridFrame(origin_x_m=-1.0, origin_y_m=2.0, resolution_m=0.05), occupied=occupied)


def full_content(tmp_path: Path) -> ReportContent:
    write_film(tmp_path / "film.webm", [np.full((96, 160, 3), 12 * k, np.uint8) for k in range(20)], fps=10)
    failed = film(tmp_path / "film.webm", "It hits a <chair>.")
    top = TopView(
        rgb=np.full((80, 120, 3), 200, np.uint8),
        frame=GridFrame(origin_x_m=-1.0, origin_y_m=2.0, resolution_m=0.025),
    )
    way = np.array([[-0.5, 3.0], [0.5, 3.2], [1.5, 3.0]])
    return ReportContent(
        title="A <demo> & more",
        subtitle="What was done.",
        scene_name="embedded",
        top_view=top,
        occupancy=occupancy(),
        episodes=(DrawnEpisode(label="train-0-1", robot_xy_m=way, goal_xy_m=way[-1], humans_xy_m=(way + 0.3,)),),
        strip=(StripImage(rgb=np.zeros((14, 25, 3), np.uint8), time_s=1.25),),
        hero=failed,
        video=tmp_path / "a film.webm",
        losses=tuple(
            Curve(name=name, x=1e5 * np.arange(5.0), y=scale * np.array([1.0, 0.5, np.nan, 0.3, 0.2]))
            for name, scale in (("training", 7.0), ("held out", 0.3))
        ),
        rates=(
            Curve(
                name="static",
                x=np.array([1.0, 2.0]),
                y=np.array([0.0, 50.0]),
                interval=np.array([[0.0, 20.0], [30.0, 80.0]]),
            ),
        ),
        ends=(Ends(name="hit a thing", xy_m=np.array([[0.5, 3.0], [0.7, 3.1]])),),
        films=(failed,),
        pages=(PageLink(href="evaluation/a <b>/failures.html", what="failures in a <b>"),),
        scores=(DriverScore(task="with people", driver="policy", summary=summary(3, 4)),),
        run=RunNumbers(
            episodes=4,
            samples=1000,
            images=200,
            learned=900,
            wall_s=20.0,
            rejected={"no <way>": 1},
            cpu_s_by_stage={"render": 3.0, "expert": 1.0},
        ),
        commands=(CommandLine(what="Everything", line="make demo && echo '<done>'"),),
        next_steps=(CommandLine(what="Your place", line="readygo scene import lobby.ply --out scenes/lobby"),),
        provenance={"commit": "abc"},
    )


class Balanced(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_report_is_one_balanced_page_that_needs_no_network(tmp_path: Path) -> None:
    html = report_html(full_content(tmp_path))
    page = Balanced()
    page.feed(html)
    assert page.open == []
    beside = [source for source in page.sources if not source.startswith(("data:image/", "data:video/"))]
    assert len(page.sources) == 6 + len(beside)
    assert beside == ["evaluation/a%20%3Cb%3E/failures.html", "a%20film.webm"]
    assert "<script" not in html
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", html)


@pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
def test_report_reads_well_on_telephones_and_its_films_play(tmp_path: Path) -> None:
    write_report(tmp_path / "report.html", full_content(tmp_path))
    with browser(tmp_path / "profile") as chromium:
        for width_px in (400, 1280):
            chromium.open(tmp_path / "report.html", width_px)
            assert_readable(chromium, width_px)
        assert_films_play(chromium)
    assert chromium.complaints == []


def test_text_is_escaped(tmp_path: Path) -> None:
    html = report_html(full_content(tmp_path))
    assert "A &lt;demo&gt; &amp; more" in html
    assert "no &lt;way&gt;" in html
    assert "echo &#39;&lt;done&gt;&#39;" in html
    assert "<demo>" not in html


def test_numbers_of_run_and_scores_are_shown(tmp_path: Path) -> None:
    html = report_html(full_content(tmp_path))
    assert "4 episodes with 1,000 samples recorded in 20 s: 50.0 samples per second. 200 of them have an image;" in html
    assert "each 4.5 times on average: 900 samples learned from." in html
    assert "<b>75 %</b>reaches its goal, with people" in html
    assert "Not recorded, of 5 tried" in html
    assert "75 %" in html
    assert "30 % to 95 %" in html
    assert "3.00 ms" in html


def test_parts_without_content_are_left_out() -> None:
    html = report_html(ReportContent(title="t", subtitle="s", scene_name="x"))
    assert "<section>" not in html
    assert "<footer>" not in html


def test_images_in_the_page_decode(tmp_path: Path) -> None:
    html = report_html(full_content(tmp_path))
    images = re.findall(r"data:image/(?:png|jpeg);base64,([A-Za-z0-9+/=]+)", html)
    shapes = [cv2.imdecode(np.frombuffer(base64.b64decode(i), np.uint8), cv2.IMREAD_COLOR).shape for i in images]
    assert (14, 25, 3) in shapes
    assert len(shapes) == 4


def test_report_appears_complete_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = full_content(tmp_path)
    out = tmp_path / "deep" / "report.html"
    write_report(out, content)
    before = out.read_text(encoding="utf-8")
    assert before.endswith("</html>\n")
    monkeypatch.setattr(Path, "replace", lambda self, target: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(ReadygoError, match=r"report.html cannot be written: disk full"):
        write_report(out, content)
    assert [path.name for path in out.parent.iterdir()] == ["report.html"]
    assert out.read_text(encoding="utf-8") == before


def test_map_picture_has_the_largest_y_on_top() -> None:
    view = map_view(occupancy(), pixels_per_cell=3)
    assert view.rgb.shape == (120, 180, 3)
    u, v = view.world_to_pixel([-0.9, 2.1])
    assert view.rgb[int(v), int(u), 0] < 200
    assert v > 100
    assert view.rgb[60, 90, 0] > 240


def test_episodes_are_drawn_where_they_were() -> None:
    view = resize_view(map_view(occupancy()), 400)
    way = np.array([[0.0, 3.0], [1.0, 3.0]])
    picture = draw_episodes(view, [DrawnEpisode(label="", robot_xy_m=way, goal_xy_m=np.array([1.5, 3.5]))])
    u, v = view.world_to_pixel([0.5, 3.0])
    assert tuple(picture[int(v), int(u)]) == ROBOT
    u, v = view.world_to_pixel([1.5, 3.5])
    assert tuple(picture[int(v), int(u)]) == GOAL


def test_speed_is_of_the_whole_run() -> None:
    assert RunNumbers(episodes=2, samples=90, images=18, learned=0, wall_s=4.5).samples_per_s == pytest.approx(20.0)


def test_run_that_took_no_time_has_no_speed() -> None:
    assert RunNumbers(episodes=0, samples=0, images=0, learned=0, wall_s=0.0).samples_per_s == 0.0
