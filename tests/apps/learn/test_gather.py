import dataclasses
import json
import shutil

import pytest

from readygo.apps.learn.choice import PolicyMeasurement
from readygo.apps.learn.curve import CurvePoint
from readygo.apps.learn.gather import _story, driver_scores
from readygo.apps.learn.learn import Learned, report_content
from readygo.apps.learn.plan import LearnPlan
from readygo.apps.report.learn import report_html
from readygo.apps.report.tables import DriverScore
from readygo.common.dataset import Dataset
from readygo.common.episode.metrics import EpisodeResult, summarize
from readygo.common.messages import DriverKind, Outcome
from readygo.runs.policy import policy_sha256
from readygo.services.evaluator import STRAIGHT_LINE, EvaluateReply, Task
from tests.common.policy.artifacts import write_policy

CHOSEN = PolicyMeasurement(fraction=0.5, policy="ab", episodes=8, static=0.5, dynamic=0.25)
POINTS = [
    CurvePoint(minutes=0.5, recorded=100, learned=400, policies=1, loss=0.2),
    CurvePoint(minutes=1.0, recorded=200, learned=900, policies=2, loss=0.1, measurement=CHOSEN),
]


def test_report_shows_how_it_learned_and_what_it_fails_in(tiny: LearnPlan) -> None:
    history = [{"samples": 400, "train_loss": 0.2, "validation_loss": 0.3}]
    (tiny.policy / "progress.json").write_text(json.dumps({"history": history}))
    learned = Learned(plan=tiny, points=POINTS, chosen=CHOSEN, replies={}, minutes=1.0)
    content = report_content(learned, ("embedded",), {"--config": "run.toml", "--learn.mix": "0.5"})
    (tiny.policy / "progress.json").unlink()
    assert [(curve.name, curve.x.tolist(), curve.y.tolist()) for curve in content.rates] == [
        ("static", [1.0], [50.0]),
        ("among humans", [1.0], [25.0]),
    ]
    low, high = content.rates[0].interval.tolist()
    assert 0 < low[0] < 50 < high[0] < 100
    assert [(curve.name, curve.x.tolist(), curve.y.tolist()) for curve in content.losses] == [
        ("training", [400.0], [0.2]),
        ("held out", [400.0], [0.3]),
    ]
    driven = [entry for entry in Dataset(tiny.places[0].folder.path).episodes if entry.driver is DriverKind.POLICY]
    failed = [entry for entry in driven if entry.outcome is not Outcome.SUCCESS]
    assert failed
    assert sum(len(ends.xy_m) for ends in content.ends) == len(failed)
    assert 0 < len(content.films) <= 2
    assert content.run is not None
    assert content.run.episodes == len(Dataset(tiny.places[0].folder.path).episodes)
    html = report_html(content)
    assert "50 % static and 25 % among humans" in html
    assert "Last places of the latest" in html
    assert f"readygo learn embedded --config run.toml --learn.mix 0.5 --minutes 2 --out {tiny.out}" in html


def test_report_of_the_second_part_links_to_the_first(tiny: LearnPlan) -> None:
    learned = Learned(plan=tiny, points=POINTS, chosen=CHOSEN, replies={}, minutes=1.0)
    page = tiny.out / "perceive" / "report.html"
    page.parent.mkdir()
    page.touch()
    content = report_content(learned, ("embedded",), {"--form": "paper", "--minutes": "4"})
    page.unlink()
    page.parent.rmdir()
    assert [link.href for link in content.pages] == ["perceive/report.html"]
    learn_on, measure, *_ = (command.line for command in content.commands)
    assert learn_on == f"readygo learn embedded --form paper --minutes 4 --out {tiny.out}"
    assert measure == f"readygo evaluate embedded {tiny.policy} --avatars embedded:test --episodes 100"
    assert report_content(learned, ("embedded",)).pages == ()


@pytest.mark.parametrize("kept", [True, False])
def test_report_says_whether_the_people_of_the_test_were_seen(tiny: LearnPlan, kept: bool) -> None:
    plan = tiny if kept else dataclasses.replace(tiny, avatars=None, tested=None)
    learned = Learned(plan=plan, points=POINTS, chosen=CHOSEN, replies={}, minutes=1.0)
    content = report_content(learned, ("embedded",))
    assert ("do not walk in the data" in content.scores_note) == kept
    assert any("--avatars" in command.line for command in content.commands) == kept


def test_report_names_the_training_of_the_policy_that_learned_last(tiny: LearnPlan) -> None:
    folder = write_policy(tiny.out / "refined" / "policy", seed=1)
    last = dataclasses.replace(CHOSEN, policy=policy_sha256(folder))
    notes = [
        report_content(
            Learned(plan=tiny, points=POINTS, chosen=chosen, replies={}, minutes=1.0), ("embedded",)
        ).training_note
        for chosen in (last, CHOSEN)
    ]
    shutil.rmtree(folder.parent)
    assert notes[
        0
    ] == f"{notes[1]} It learned in refined/, with perception from all images; these losses are of the " + (
        "policy before it."
    )


def test_run_without_a_measurement_says_so(tiny: LearnPlan) -> None:
    point = dataclasses.replace(POINTS[1], measurement=None)
    learned = Learned(plan=tiny, points=[point], chosen=None, replies={}, minutes=1.0)
    content = report_content(learned, ("embedded",))
    assert "none was measured" in content.training_note
    assert report_html(content)


def test_story_names_who_drove_how_well() -> None:
    result = EpisodeResult(outcome=Outcome.SUCCESS, duration_s=1.0, path_length_m=1.0, shortest_m=1.0)
    summary = summarize([result], time_limit_s=50.0)
    scores = [
        DriverScore(task="static", driver=driver, summary=summary) for driver in ("policy", "expert", "straight line")
    ]
    assert "reaches its goal in 100 % static; the expert" in _story(scores)
    assert _story(scores[1:]) == ""


def test_scores_name_the_scene_where_there_are_several() -> None:
    result = EpisodeResult(outcome=Outcome.SUCCESS, duration_s=1.0, path_length_m=1.0, shortest_m=1.0)
    summary = summarize([result], time_limit_s=50.0)
    reply = EvaluateReply(records=(), summaries={(Task.DYNAMIC, STRAIGHT_LINE): summary}, skipped=0, episodes=())
    (alone,) = driver_scores({"hall": reply})
    assert (alone.task, alone.driver, alone.summary) == ("among humans", STRAIGHT_LINE, summary)
    assert [score.task for score in driver_scores({"hall": reply, "flat": reply})] == [
        "among humans, hall",
        "among humans, flat",
    ]
