import dataclasses
from collections.abc import Callable

from readygo.apps.pages.scores import Score, scores_section
from readygo.common.episode import TaskSummary

SUMMARY = TaskSummary(
    episode_count=1200,
    success_rate=0.25,
    success_rate_low=0.125,
    success_rate_high=0.5,
    art_s=12.34,
    spl=0.2,
    static_collision_rate=0.4,
    human_collision_rate=0.3,
    timeout_rate=0.05,
)


def scores() -> list[Score]:
    return [
        Score(task=task, driver=driver, summary=SUMMARY) for task in ("static", "<b>") for driver in ("policy", "me")
    ]


def test_every_task_has_its_bars_and_the_watched_driver_stands_out() -> None:
    html = scores_section(scores(), watched="me")
    assert html.count("<h3>") == 2
    assert html.count('<div class="rates own"><span>me</span>') == 2
    assert html.count('<div class="rates"><span>policy</span>') == 2
    assert "&lt;b&gt;" in html


def test_all_numbers_are_there_and_the_note_is_no_markup() -> None:
    html = scores_section(scores(), note="Of <two> tasks.")
    for text in ("25 %", "12 % to 50 %", "12.3 s", "0.20", "30 %", "40 %", "5 %", "1,200", "Of &lt;two&gt; tasks."):
        assert text in html


def test_section_looks_as_it_did(golden_page: Callable[[str, str], None]) -> None:
    other = dataclasses.replace(SUMMARY, success_rate=0.62, success_rate_low=0.55, success_rate_high=0.71, art_s=9.96)
    shown = [
        Score(task="static", driver="policy", summary=SUMMARY),
        Score(task="among <humans>", driver="policy", summary=other),
        Score(task="static", driver="<expert>", summary=other),
    ]
    golden_page("scores", scores_section(shown, note="And & more."))
