from readygo.apps.evaluation.watch import SHOWN_MAX, film_path, shown, write_films, write_pages
from readygo.common.messages import Outcome
from readygo.services.evaluator import POLICY
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
    write_pages(evaluated.replays, evaluated.request, evaluated.reply, title="random")
    failures = sum(record.result.outcome is not Outcome.SUCCESS for record in records)
    gallery = (evaluated.folder / "failures.html").read_text()
    assert failures > 0
    assert gallery.count(f"readygo plan --from {evaluated.folder}") == failures
    assert films[0].name in (evaluated.folder / "report.html").read_text()


def test_page_has_room_for_some_of_every_kind():
    late = [record(index, Outcome.TIMEOUT) for index in range(40)]
    failed = [*late, record(50, Outcome.HUMAN_COLLISION)]
    found = shown(failed)
    assert len(found) == SHOWN_MAX
    assert found[-1].episode.index == 50
