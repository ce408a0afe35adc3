from pathlib import Path

import cv2
import pytest

from readygo.apps.commands.play import PlayOptions, play
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import write_left_shard


def test_film_has_the_episodes_pictures(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    play(PlayOptions(data=data, out=tmp_path / "film.webm", episode=-1, every=5))
    assert "train-7-000002, 1.0 s, success" in capsys.readouterr().out
    film = cv2.VideoCapture(str(tmp_path / "film.webm"))
    count = 0
    while film.read()[0]:
        count += 1
    assert count == 4


def test_one_camera_of_several_is_shown(tmp_path: Path) -> None:
    write_left_shard(tmp_path / "data", [0])
    play(PlayOptions(data=tmp_path / "data", out=tmp_path / "film.webm", camera="left", every=5))
    assert cv2.VideoCapture(str(tmp_path / "film.webm")).read()[0]
    with pytest.raises(DatasetError, match="no images of a camera 'rear'"):
        play(PlayOptions(data=tmp_path / "data", out=tmp_path / "film.webm", camera="rear"))


@pytest.mark.parametrize("episode", [3, -4])
def test_episode_that_is_not_there_is_said(data: Path, tmp_path: Path, episode: int) -> None:
    with pytest.raises(DatasetError, match="it has 3, from 0 to 2"):
        play(PlayOptions(data=data, out=tmp_path / "film.webm", episode=episode))


def test_film_keeps_the_pace_of_the_episode(data: Path, tmp_path: Path) -> None:
    play(PlayOptions(data=data, out=tmp_path / "film.webm", every=3))
    film = cv2.VideoCapture(str(tmp_path / "film.webm"))
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(20 / 3, abs=0.01)
