"""Dashboard and alerts name what processes show, and commands that there are."""

import json
import re
import shutil
import subprocess
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from readygo.apps.fleet.fleet import FleetMember
from readygo.apps.fleet.run import run_in_process
from readygo.apps.observe.collectors import of_launcher, of_recorder
from readygo.apps.observe.metrics import Metrics
from readygo.apps.observe.settings import Observing
from readygo.commands import COMMANDS
from readygo.common.bus import InProcessBus
from readygo.services.recorder import Recorder
from tests.apps.fleet.toy_line import DRAW, FILM, make_folder
from tests.common.dataset.episodes import PROVENANCE

client = pytest.importorskip("prometheus_client", reason="prometheus-client (the extra `metrics`) is not installed")
MONITORING = Path(__file__).resolve().parents[2] / "deploy" / "monitoring"
OF_TARGETS = {"run", "service", "worker"}
"""Labels that come with a target, see `Observer`."""
METRIC = re.compile(r"\b(?:readygo|process)_\w+")
Shown = dict[str, set[str]]


def _read(page: str) -> Shown:
    """Names on a page, with the labels that they have."""
    shown: Shown = {}
    for name, labels in re.findall(r"^(\w+)(?:\{(.*)\})? \S+$", page, re.MULTILINE):
        shown.setdefault(name, set()).update(re.findall(r'(\w+)="', labels))
    # Counters and histograms of what did not happen are declared, and have no samples.
    for name, kind in re.findall(r"^# TYPE (\w+) (counter|histogram)$", page, re.MULTILINE):
        for suffix in ("_bucket", "_count", "_sum") if kind == "histogram" else ("",):
            shown.setdefault(f"{name}{suffix}", {"topic", "stage", "outcome", "le"})
    return shown


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """All that the processes of a run show: a toy run, with a recorder and a launcher beside it."""
    data = tmp_path_factory.mktemp("run") / "data"
    folder = make_folder(data, (DRAW, FILM), wanted=2)
    pages: list[str] = []

    def look(status: object) -> None:
        (target,) = (folder.state / "targets").glob("*.json")
        ((at,),) = (entry["targets"] for entry in json.loads(target.read_text()))
        pages.append(urllib.request.urlopen(f"http://{at}/metrics").read().decode())

    run_in_process(folder, look, (DRAW, FILM), Observing(metrics="127.0.0.1:0"))
    recorder = Recorder(data / "other", "rec0", InProcessBus(), PROVENANCE)
    for gauges in (of_recorder(recorder), of_launcher([FleetMember(role="all", name="all0", log=data)])):
        metrics = Metrics()
        metrics.look_up(gauges)
        pages.append(client.generate_latest(metrics.registry).decode())
    recorder.close()
    return {name: labels for page in pages for name, labels in _read(page).items()}


def _alerts() -> list[dict[str, Any]]:
    (group,) = yaml.safe_load((MONITORING / "alerts.yaml").read_text())["groups"]
    return list(group["rules"])


def _queries() -> Iterator[str]:
    yield from (alert["expr"] for alert in _alerts())
    dashboard = json.loads((MONITORING / "grafana.json").read_text())
    yield from (target["expr"] for panel in dashboard["panels"] for target in panel["targets"])


def test_what_dashboard_and_alerts_ask_for_is_shown(shown: Shown) -> None:
    asked = {name for query in _queries() for name in METRIC.findall(query)}
    assert sorted(asked - shown.keys()) == []
    assert len(asked) > 20


def test_labels_that_they_ask_for_are_there(shown: Shown) -> None:
    for query in _queries():
        known = OF_TARGETS | {label for name in METRIC.findall(query) for label in shown.get(name, ())}
        asked = set(re.findall(r'(\w+)\s*=~?"', query))
        for group in re.findall(r"\b(?:by|on) \(([^)]*)\)", query):
            asked |= {label.strip() for label in group.split(",")}
        assert asked <= known, query


def test_labels_of_targets_are_no_metric_s_own(shown: Shown) -> None:
    assert {name for name, labels in shown.items() if labels & OF_TARGETS} == set()


@pytest.mark.parametrize("alert", _alerts(), ids=lambda alert: alert["alert"])
def test_alert_names_what_to_do(alert: dict[str, Any]) -> None:
    words = alert["annotations"]
    named = re.findall(r"`readygo ([a-z]+(?: [a-z]+)?)", words["do"])
    assert all(any(name.split()[0] == command.split()[0] for command in COMMANDS) for name in named)
    assert named or "log" in words["do"] or "Make room" in words["do"]
    assert set(alert["labels"]) == {"severity"}


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool is not installed")
def test_promtool_finds_nothing_wrong() -> None:
    for what, file in (("rules", "alerts.yaml"), ("config", "prometheus.yaml")):
        done = subprocess.run(
            ["promtool", "check", what, file], cwd=MONITORING, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
