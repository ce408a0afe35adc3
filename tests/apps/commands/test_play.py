from pathlib import Path

import cv2
import pytest

from readygo.apps.commands.play import play
from readygo.common.errors import DatasetError


def test_film_has_the_episodes_pictures(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    play(data, out=tmp_path / "film.webm", episode=-1, every=5)
    assert "train-7-000002, 1.0 s, success" in capsys.readouterr().out
    film = cv2.VideoCapture(str(tmp_path / "film.webm"))
    count = 0
    while film.read()[0]:
        count += 1
    assert count == 4


@pytest.mark.parametrize("episode", [3, -4])
def test_episode_that_is_not_there_is_said(data: Path, tmp_path: Path, episode: int) -> None:
    with pytest.raises(DatasetError, match="it has 3, from 0 to 2"):
        play(data, out=tmp_path / "film.webm", episode=episode)
