import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.report.evaluation import EvaluationContent, Failure, draw_runs, gallery_html, report_html
from readygo.apps.report.page import Paragraph, StripImage
from readygo.common.drawing.plan_view import HUMANS, ROBOT
from readygo.common.episode import Conduct, Contact
from readygo.common.messages import Outcome
from readygo.services.evaluator import POLICY, Category, Task, summarize_records
from tests.apps.evaluation.records import RECORDS
from tests.services.planner.runs import make_run
from tests.services.planner.worlds import rooms


@pytest.fixture
def content():
    failed = [record for record in RECORDS if record.result.outcome is not Outcome.SUCCESS]
    image = np.zeros((8, 10, 3), np.uint8)
    failures = [
        Failure(
            record=record,
            goal_distance_m=3.2,
            picture=image,
            strip=[StripImage(time_s=1.5, rgb=image)],
            film=Path("results") / "films" / "a.webm",
            command="readygo plan 'my flat'",
        )
        for record in failed
    ]
    return EvaluationContent(
        title="policy in a <flat>",
        watched=POLICY,
        summaries=summarize_records(RECORDS, time_limit_s=50.0),
        occupancy=rooms(),
        runs=[(record, make_run().trajectory) for record in RECORDS],
        failure_count=3,
        failures=failures,
        films=[(failed[0], Path("results") / "films" / "a.webm")],
        facts={"scene": "ab"},
    )


def test_report_tells_the_rates_and_links_films_and_failures(content):
    html = report_html(content)
    assert "policy in a &lt;flat&gt;" in html
    assert '<a href="failures.html">' in html
    assert 'src="films/a.webm"' in html
    for end in ("reached the goal: 3", "hit a human: 1", "hit a thing: 1", "too late: 1"):
        assert end in html
    assert "40 %" in html


def test_gallery_is_sorted_by_kind_with_what_the_robot_saw_and_how_to_see_more(content):
    html = gallery_html(content)
    assert html.index("<h2>Too late, among humans") < html.index("<h2>Hit a human") < html.index("<h2>Hit a thing")
    assert html.count("<figcaption>1.50 s</figcaption>") == 3
    assert "humans came as near as 0.50 m" in html
    assert "readygo plan &#39;my flat&#39;" in html
    assert "all 3." in html


def test_ways_and_ends_are_on_the_map(content):
    picture = draw_runs(content.occupancy, content.runs[2:3]).reshape(-1, 3)
    for colour in (ROBOT, HUMANS[0]):
        assert (picture == colour).all(axis=1).any()


def test_pages_look_as_they_did(content, golden_page: Callable[[str, str], None]):
    conduct = Conduct(
        intrusion_s=1.25,
        near_misses=2,
        jerk_mps3=2.5,
        turn_acceleration_radps2=0.5,
        contact=Contact(robot_mps=0.45, in_view=False, seen_s=2.34),
    )
    why = dataclasses.replace(
        content.failures[1].record,
        result=dataclasses.replace(content.failures[1].record.result, conduct=conduct, duration_s=7.125),
        category=Category.SEEN_HUMAN,
        reason="it <slept>",
    )
    seen = dataclasses.replace(
        why,
        task=Task.STATIC,
        result=dataclasses.replace(
            why.result, conduct=dataclasses.replace(conduct, contact=Contact(robot_mps=0.45, in_view=True, seen_s=0.06))
        ),
    )
    first, second, third = content.failures
    failures = [
        dataclasses.replace(second, record=why, film=None),
        dataclasses.replace(first, goal_distance_m=0.67, command=""),
        third,
        dataclasses.replace(second, record=seen, strip=[*second.strip, StripImage(time_s=2.25, rgb=second.picture)]),
    ]
    crooked = dataclasses.replace(
        content, failures=failures, failure_count=17, tables={"More": [Paragraph(text="<m>")], "No": []}
    )
    golden_page("evaluation_report", report_html(crooked))
    golden_page("evaluation_failures", gallery_html(crooked))
    fine = dataclasses.replace(content, failures=[], failure_count=0, runs=[], films=[], watched="straight-line")
    golden_page("evaluation_without_failures", report_html(fine) + gallery_html(fine))
