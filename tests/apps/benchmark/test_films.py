from pathlib import Path

from readygo.apps.benchmark import films
from readygo.apps.benchmark.leaderboard import read_leaderboard
from readygo.runs.benchmark.suite import OpenSuite


def test_films_replay_the_kept_commands_of_each_row_and_are_written_once(
    driven: Path, suite: OpenSuite, tmp_path: Path, monkeypatch
):
    filmed = []

    def film(replays, path, record):
        filmed.append((path.name, replays.trajectory(record).outcome is record.result.outcome))
        path.touch()

    monkeypatch.setattr(films.Replays, "film", film)
    board = read_leaderboard([driven], suite)
    figures = films.film_leaderboard(board, tmp_path)
    names = [f"{row}-{word}.webm" for row in ("expert-oracle", "straight-line") for word in ("median", "worst")]
    assert filmed == [(name, True) for name in names]
    assert [figure.video for figure in figures] == [f"films/{name}" for name in names]
    assert "the worst of people" in figures[1].caption
    assert films.film_leaderboard(board, tmp_path) == figures
    assert len(filmed) == 4
