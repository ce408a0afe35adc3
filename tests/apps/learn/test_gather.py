import dataclasses

from readygo.apps.learn.choice import Measurement
from readygo.apps.learn.curve import CurvePoint
from readygo.apps.learn.learn import Learned, report_content
from readygo.apps.learn.plan import Plan
from readygo.apps.learn.report import report_html
from readygo.common.dataset import Dataset
from readygo.common.messages import Driver, Outcome

CHOSEN = Measurement(fraction=0.5, policy="ab", episodes=8, static=0.5, dynamic=0.25)
POINTS = [
    CurvePoint(minutes=0.5, recorded=100, learned=400, policies=1, loss=0.2),
    CurvePoint(minutes=1.0, recorded=200, learned=900, policies=2, loss=0.1, measurement=CHOSEN),
]


def test_report_shows_how_it_learned_and_what_it_fails_in(tiny: Plan) -> None:
    learned = Learned(plan=tiny, points=POINTS, chosen=CHOSEN, replies={}, minutes=1.0)
    content = report_content(learned, ("embedded",), avatars=None, config="run.toml")
    assert [(curve.name, curve.x.tolist(), curve.y.tolist()) for curve in content.rates] == [
        ("static", [1.0], [50.0]),
        ("among humans", [1.0], [25.0]),
    ]
    assert content.losses[0].x.tolist() == [400.0, 900.0]
    driven = [entry for entry in Dataset(tiny.places[0].folder.path).episodes if entry.driver is Driver.POLICY]
    failed = [entry for entry in driven if entry.outcome is not Outcome.SUCCESS]
    assert failed
    assert sum(len(ends.xy_m) for ends in content.ends) == len(failed)
    assert 0 < len(content.films) <= 4
    assert content.run is not None
    assert content.run.episodes == len(Dataset(tiny.places[0].folder.path).episodes)
    html = report_html(content)
    assert "50 % static and 25 % among humans" in html
    assert "Where it failed:" in html
    assert f"readygo learn embedded --config run.toml --minutes 2 --out {tiny.out}" in html


def test_run_without_a_measurement_says_so(tiny: Plan) -> None:
    point = dataclasses.replace(POINTS[1], measurement=None)
    learned = Learned(plan=tiny, points=[point], chosen=None, replies={}, minutes=1.0)
    content = report_content(learned, ("embedded",))
    assert "none was measured" in content.training_note
    assert report_html(content)
