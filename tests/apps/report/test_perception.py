import dataclasses
from pathlib import Path

import pytest

from readygo.apps.report.page import CommandLine, PageLink
from readygo.apps.report.perception import (
    PerceptionContent,
    perception_facts,
    perception_html,
    write_perception_report,
)

HELD_OUT = {
    "images": 2000, "people": 816, "average_precision": 0.82, "bearing_deg": 0.35, "distance": 0.05, "missed": 0.16,
    "false_per_image": 0.0225, "along_r2": 0.33, "across_r2": 0.02, "rays": 0.07,
}  # fmt: skip
METRICS = {"images": 54900, "samples_seen": 185280, "parameters": 653770, "held_out": HELD_OUT}


@pytest.fixture
def content() -> PerceptionContent:
    return PerceptionContent(
        title="perceive-and-plan in hall",
        method="perceive-and-plan",
        val={"perceive-and-act": 0.4, "perceive-and-plan": 0.53},
        scores=(),
        metrics=METRICS,
        minutes=61.2,
        unseen=True,
        pages=(PageLink(href="evaluation/hall/report.html", what="hall"),),
        commands=(CommandLine(what="test it again", line="readygo evaluate hall"),),
    )


def test_page_says_what_is_seen_and_how_to_go_on(content: PerceptionContent) -> None:
    html = perception_html(content)
    for text in (
        "perceive-and-plan in hall",
        "61 min",
        "54,900",
        "53 % by perceive-and-plan",
        "The expert plans among them",
        "0.82",
        "16 %",
        "evaluation/hall/report.html",
    ):
        assert text in html
    assert "readygo evaluate hall" in html


def test_page_says_whether_the_people_of_the_test_were_seen(content: PerceptionContent) -> None:
    assert "The people of the test do not walk in the data." in perception_html(content)
    seen = perception_html(dataclasses.replace(content, unseen=False))
    assert "The people of the test do not walk" not in seen
    assert "People of the test, or variants of them, walk in the data" in seen


def test_facts_without_held_out_images_are_the_number_learned_from() -> None:
    assert perception_facts({"samples_seen": 64}) == [("images learned from, repeats counted", "64")]
    assert dict(perception_facts(METRICS))["missed, of visible people within 6 m"] == "16 %"


def test_report_is_written_in_one_piece(content: PerceptionContent, tmp_path: Path) -> None:
    write_perception_report(tmp_path / "report.html", content)
    assert (tmp_path / "report.html").read_text() == perception_html(content)
