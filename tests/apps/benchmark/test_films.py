import dataclasses
from pathlib import Path

from readygo.apps.benchmark import films
from readygo.apps.benchmark.leaderboard import films_to_show, read_leaderboard
from readygo.runs.benchmark.suite import OpenSuite


def test_films_replay_the_kept_commands_of_each_row_and_are_written_once(
    driven: Path, suite: OpenSuite, tmp_path: Path, monkeypatch
):
    filmed = []

    def film(replays, path, record):
        filmed.append((path, replays.trajectory(record).outcome is record.result.outcome))
        path.touch()

    monkeypatch.setattr(films.Replays, "film", film)
    board = read_leaderboard([driven], suite)
    figures = films.film_leaderboard(board, tmp_path)
    chosen = [record for _, _, record in films_to_show(board)]
    assert filmed == [(tmp_path / figure.video, True) for figure in figures]
    for record, figure in zip(chosen, figures, strict=True):
        assert figure.video.startswith(f"films/{record.method}-{record.episode.episode_id}-")
    assert "the worst of people" in figures[1].caption
    assert films.film_leaderboard(board, tmp_path) == figures
    assert len(filmed) == 4


def test_record_that_differs_has_another_film(driven: Path, suite: OpenSuite):
    (_, _, record), *_ = films_to_show(read_leaderboard([driven], suite))
    other = dataclasses.replace(record, human_distance_min_m=0.125)
    mine = dataclasses.replace(record, method="../drivers/one.py:Mine")
    names = {films.film_name(suite, each) for each in (record, other, mine)}
    assert len(names) == 3
    assert not any("/" in name or ":" in name for name in names)
