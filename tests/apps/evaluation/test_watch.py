from types import SimpleNamespace

import pytest

from readygo.apps.evaluation.watch import (
    SHOWN_MAX,
    avoided,
    check_wanted,
    episodes_to_film,
    failures_to_show,
    film_path,
    pedestrians_text,
    watched_method,
    write_films,
    write_pages,
)
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import RunError
from readygo.common.messages import Outcome
from readygo.runs.config import RunConfig
from readygo.services.evaluator import EXPERT, POLICY, STRAIGHT_LINE, Task
from readygo.services.planner import HumanPlannerConfig
from tests.apps.evaluation.records import RECORDS, record

PAIR = (Task.DYNAMIC, Task.STATIC)


def test_pages_and_films_are_made_of_what_was_kept(evaluated):
    records = [record for record in evaluated.reply.records if record.method == POLICY]
    index = records[0].episode.index
    films = [film_path(evaluated.folder, record) for record in records if record.episode.index == index]
    write_films(evaluated.replays, evaluated.request, evaluated.reply, [str(index)])
    assert sorted(path.name for path in (evaluated.folder / "films").iterdir()) == sorted(path.name for path in films)
    before = [path.stat().st_mtime_ns for path in films]
    write_films(evaluated.replays, evaluated.request, evaluated.reply, [str(index)])
    assert [path.stat().st_mtime_ns for path in films] == before, "what is there is not made again"
    write_pages(evaluated.replays, evaluated.request, evaluated.reply, title="random")
    failures = sum(record.result.outcome is not Outcome.SUCCESS for record in records)
    gallery = (evaluated.folder / "failures.html").read_text()
    assert failures > 0
    assert gallery.count(f"readygo plan --from {evaluated.folder}") == failures
    report = (evaluated.folder / "report.html").read_text()
    assert films[0].name in report
    assert "1 to 2 at 0.8 to 1.4 m/s" in report


@pytest.mark.parametrize(
    ("episode", "standing", "text"),
    [
        ({}, 0, "1 to 2 at 0.8 to 1.4 m/s"),
        ({"human_count_min": 2, "human_speed_max_mps": 0.8}, 0, "2 at 0.8 m/s"),
        ({"human_count_max": 4, "human_speed_min_mps": 0.5}, 2, "1 to 4 at 0.5 to 1.4 m/s, and up to 2 who stand"),
    ],
)
def test_pedestrians_are_told_by_number_and_speed(episode, standing, text):
    config = RunConfig(episode=EpisodeConfig(**episode), human_planner=HumanPlannerConfig(standing_max=standing))
    drawn, listed = (
        SimpleNamespace(spec=SimpleNamespace(scenarios=file), config=config) for file in ("", "[[people]]")
    )
    assert pedestrians_text(drawn) == text
    assert pedestrians_text(listed) == "as in the scenario file"


def test_page_has_room_for_some_of_every_kind():
    late = [record(index, Outcome.TIMEOUT) for index in range(40)]
    failed = [*late, record(50, Outcome.HUMAN_COLLISION)]
    found = failures_to_show(failed)
    assert len(found) == SHOWN_MAX
    assert found[-1].episode.index == 50


def indices(*wanted):
    return [each.episode.index for each in episodes_to_film(RECORDS, wanted)]


def test_failures_come_by_how_bad_they_are():
    assert indices("failures") == [3, 5, 1]


def test_worst_are_few_and_end_with_the_success_that_came_nearest_to_a_human():
    assert indices("worst") == [3, 5, 1, 4]


def test_index_means_every_task_and_nothing_is_filmed_twice():
    assert indices("5") == [5, 5]
    assert indices("failures", "3", "0") == [3, 5, 1, 0]
    assert indices() == []


def test_what_is_no_episode_is_refused():
    with pytest.raises(RunError, match="index 2: indices without a scenario leave gaps"):
        episodes_to_film(RECORDS, ["2"])
    with pytest.raises(RunError, match="'best'"):
        check_wanted(["worst", "17", "best"], ["dynamic"])
    check_wanted(["worst", "failures", "17"], ["dynamic"])
    for tasks in (["dynamic"], ["static"]):
        with pytest.raises(RunError, match="compares a task with humans with the one without: --tasks static dynamic"):
            check_wanted(["avoided"], tasks)
    check_wanted(["avoided"], ["static", "dynamic"])


def test_avoided_are_goals_reached_where_the_way_without_humans_meets_one_the_closest_pass_first():
    near_m = {1: 0.9, 2: 0.0, 3: 0.4, 4: 0.6, 5: 0.1, 6: 0.2}
    ours = [record(k, Outcome.HUMAN_COLLISION if k == 2 else Outcome.SUCCESS, near_m[k]) for k in near_m]
    alone = [record(k, Outcome.SUCCESS, task=Task.STATIC) for k in range(1, 6)]
    asked = []

    def meets_human(one, other):
        asked.append((one.episode, other.episode))
        assert (one.task, other.task) == (Task.DYNAMIC, Task.STATIC)
        return one.episode.index != 5

    replays = SimpleNamespace(load=list, meets_human=meets_human)
    found = avoided([*ours, *alone], replays)
    assert [each.episode.index for each in found] == [3, 4, 1]
    assert all(one == other for one, other in asked)
    assert [each.episode.index for each in episodes_to_film([*ours, *alone], ["avoided"], found)] == [3, 4]


def test_commands_of_the_episode_without_humans_are_replayed_among_them(evaluated):
    replays, records = evaluated.replays, evaluated.reply.records
    pairs = [
        (one, other)
        for one in records
        for other in records
        if (one.method, one.episode) == (other.method, other.episode) and (one.task, other.task) == PAIR
    ]
    replays.load(records)
    assert pairs
    for one, other in pairs:
        # Who met a human without looking, by the same commands, meets it again.
        assert replays.meets_human(one, one) == (one.result.outcome is Outcome.HUMAN_COLLISION)
        if other.result.outcome is Outcome.SUCCESS:
            assert replays.meets_human(other, other) is False


def test_policy_is_watched_where_one_drives():
    assert watched_method([EXPERT, POLICY]) == POLICY
    assert watched_method([EXPERT, STRAIGHT_LINE]) == EXPERT
