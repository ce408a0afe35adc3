from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from readygo.apps.demo import demo
from readygo.apps.demo.demo import _clear
from readygo.apps.evaluation.watch import film_path
from readygo.common.errors import DatasetError, RunError
from readygo.common.messages import Outcome
from readygo.services.evaluator import EXPERT
from tests.apps.evaluation.records import record
from tests.common.dataset.episodes import write_shard


def test_demo_refuses_a_folder_that_no_demo_has_made(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "shard-rec0-00000.mcap").write_text("precious")
    with pytest.raises(RunError, match="holds files of something else"):
        _clear(tmp_path)
    assert (tmp_path / "data" / "shard-rec0-00000.mcap").read_text() == "precious"


def test_demo_replaces_an_earlier_demo(tmp_path: Path) -> None:
    _clear(tmp_path / "demo")
    (tmp_path / "demo" / "run").mkdir()
    _clear(tmp_path / "demo")
    assert not (tmp_path / "demo" / "run").exists()


def test_ctrl_c_says_that_the_demo_begins_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(demo, "warm_all", interrupt)
    with pytest.raises(KeyboardInterrupt, match=r"^the same command begins the demo again\.$"):
        demo.demo(demo.DemoOptions(out=tmp_path / "demo"))


def test_film_shows_the_closest_pass_of_the_policy_that_was_filmed(tmp_path: Path) -> None:
    records = [record(k, Outcome.SUCCESS, near_m) for k, near_m in ((1, 0.7), (2, 0.5), (3, 0.4))]
    expert = record(4, Outcome.SUCCESS, 0.2, method=EXPERT)
    assert demo.closest_pass([*records, expert], tmp_path) is None
    for filmed in (*records[:2], expert):
        film_path(tmp_path, filmed).parent.mkdir(exist_ok=True)
        film_path(tmp_path, filmed).touch()
    assert demo.closest_pass([*records, expert], tmp_path) == film_path(tmp_path, records[1])


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The data of a demo that records two small episodes instead of learning."""
    data = tmp_path / "data"
    place = SimpleNamespace(name="embedded", folder=SimpleNamespace(path=data))
    plan = SimpleNamespace(places=[place], image_count=lambda samples: samples // 5)

    def learn(_: object, *, recorded: Callable[[], None], **__: object) -> Any:
        recorded()
        return SimpleNamespace(replies={"embedded": SimpleNamespace(summaries=())})

    write_shard(data, [0, 1])
    for name, stand_in in (
        ("warm_all", lambda: None),
        ("make_plan", lambda *_, **__: plan),
        ("learn_policy", learn),
        ("_write_pictures", lambda *_: None),
        ("summary_table", lambda _: "the table"),
    ):
        monkeypatch.setattr(demo, name, stand_in)
    return data


def test_demo_checks_its_data_beside_the_test_and_names_what_it_counts(small: Path, tmp_path: Path, capsys) -> None:
    demo.demo(demo.DemoOptions(out=tmp_path / "demo"))
    assert "24 samples recorded, 4 with an image; all sound" in capsys.readouterr().err


def test_demo_whose_data_are_damaged_says_so(small: Path, tmp_path: Path) -> None:
    (shard,) = small.glob("*.mcap")
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 1
    shard.write_bytes(content)
    with pytest.raises(DatasetError, match="has defects, the first: "):
        demo.demo(demo.DemoOptions(out=tmp_path / "demo"))
