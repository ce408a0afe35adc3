import json
import shlex

from readygo.apps.commands.plan import plan
from readygo.apps.evaluation.watch import SHOWN_MAX, film_path, plan_command, shown, write_films, write_pages
from readygo.apps.run.evaluation import make_request
from readygo.common.messages import Outcome, Split
from readygo.services.evaluator import POLICY, Task
from tests.apps.evaluation.test_choice import record


def test_pages_and_films_are_made_of_what_was_kept(evaluated):
    records = [record for record in evaluated.reply.records if record.method == POLICY]
    index = records[0].episode.index
    films = [film_path(evaluated.folder, record) for record in records if record.episode.index == index]
    write_films(evaluated.replays, evaluated.request, evaluated.reply, [str(index)])
    assert sorted(path.name for path in (evaluated.folder / "films").iterdir()) == sorted(path.name for path in films)
    before = [path.stat().st_mtime_ns for path in films]
    write_films(evaluated.replays, evaluated.request, evaluated.reply, [str(index)])
    assert [path.stat().st_mtime_ns for path in films] == before, "what is there is not made again"
    command_of = plan_command("embedded", evaluated.request, {"policy": evaluated.policy, "robot": None})
    write_pages(evaluated.replays, evaluated.request, evaluated.reply, title="random", command_of=command_of)
    failures = sum(record.result.outcome is not Outcome.SUCCESS for record in records)
    gallery = (evaluated.folder / "failures.html").read_text()
    assert failures > 0
    assert gallery.count("readygo plan embedded") == failures
    assert films[0].name in (evaluated.folder / "report.html").read_text()


def test_plan_takes_an_episode_of_an_evaluation_again(evaluated, capsys):
    driven = evaluated.reply.records[0]
    capsys.readouterr()
    options = {"policy": evaluated.policy, "config": evaluated.config, "split": "test", "index": driven.episode.index}
    plan("embedded", **options, static=driven.task is Task.STATIC, json=True)
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["driver"] == "policy"
    assert numbers["outcome"] == driven.result.outcome.value
    assert numbers["duration_s"] == driven.result.duration_s
    assert abs(numbers["path_length_m"] - driven.result.path_length_m) < 1e-3


def test_command_names_what_the_evaluation_was_given():
    request = make_request(3, ("static",), ("expert",), Split.VAL, 7)
    command_of = plan_command("my flat", request, {"people": "crowd", "policy": None})
    assert command_of is not None
    words = shlex.split(command_of(record(4, Outcome.TIMEOUT, task=Task.STATIC)))
    assert words[:3] == ["readygo", "plan", "my flat"]
    assert words[3:5] == ["--people", "crowd"]
    assert "--policy" not in words
    assert "--static" in words
    assert plan_command("flat", make_request(3, ("static",), ("policy",), Split.VAL, 7, control_hz=4), {}) is None


def test_page_has_room_for_some_of_every_kind():
    late = [record(index, Outcome.TIMEOUT) for index in range(40)]
    failed = [*late, record(50, Outcome.HUMAN_COLLISION)]
    found = shown(failed)
    assert len(found) == SHOWN_MAX
    assert found[-1].episode.index == 50
