import pytest

from readygo.apps.evaluation.watch import (
    SHOWN_MAX,
    avoided,
    check_wanted,
    episodes_to_film,
    failures_to_show,
    film_path,
    watched_method,
    write_films,
    write_pages,
)
from readygo.common.errors import RunError
from readygo.common.messages import Outcome
from readygo.services.evaluator import EXPERT, POLICY, STRAIGHT_LINE
from tests.apps.evaluation.records import RECORDS, record


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
    assert films[0].name in (evaluated.folder / "report.html").read_text()


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
        check_wanted(["worst", "17", "best"], [POLICY])
    check_wanted(["worst", "failures", "17"], [POLICY])
    with pytest.raises(RunError, match="--video avoided compares with straight-line: name it among --methods as well"):
        check_wanted(["avoided"], [POLICY, EXPERT])
    check_wanted(["avoided"], [POLICY, STRAIGHT_LINE])


def test_avoided_are_goals_reached_where_the_straight_line_meets_a_human_the_closest_pass_first():
    met = [record(k, Outcome.HUMAN_COLLISION, method=STRAIGHT_LINE) for k in (1, 2, 3, 4)]
    others = [*met, record(5, Outcome.STATIC_COLLISION, method=STRAIGHT_LINE)]
    ours = [
        record(1, Outcome.SUCCESS, near_m=0.9),
        record(2, Outcome.HUMAN_COLLISION, near_m=0.0),
        record(3, Outcome.SUCCESS, near_m=0.4),
        record(4, Outcome.SUCCESS, near_m=0.6),
        record(5, Outcome.SUCCESS, near_m=0.1),
    ]
    assert [each.episode.index for each in avoided(ours, [*ours, *others])] == [3, 4, 1]
    assert [each.episode.index for each in episodes_to_film(ours, ["avoided"], others)] == [3, 4]
    assert episodes_to_film(ours, ["avoided"], ours) == []


def test_policy_is_watched_where_one_drives():
    assert watched_method([EXPERT, POLICY]) == POLICY
    assert watched_method([EXPERT, STRAIGHT_LINE]) == EXPERT
