"""Films are written whole, at the simulation's pace, or not at all."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.drawing.film import write_film
from readygo.common.errors import ReadygoError


def test_film_plays_back_with_all_pictures(tmp_path: Path) -> None:
    pictures = [np.full((48, 64, 3), 10 * k, np.uint8) for k in range(10)]
    write_film(tmp_path / "new" / "film.mp4", pictures)
    capture = cv2.VideoCapture(str(tmp_path / "new" / "film.mp4"))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(20.0)
    levels = []
    while (read := capture.read())[0]:
        levels.append(float(read[1].mean()))
    np.testing.assert_allclose(levels, np.arange(10) * 10, atol=8)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["film.mp4"]


def test_missing_encoders_leave_no_file_and_no_noise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("readygo.common.drawing.film.CODECS", ("none",))
    with pytest.raises(ReadygoError, match="cannot write videos"):
        write_film(tmp_path / "film.mp4", [np.zeros((48, 64, 3), np.uint8)])
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_folder_that_cannot_be_made_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ReadygoError, match="cannot be written"):
        write_film(tmp_path / "file" / "film.mp4", [np.zeros((48, 64, 3), np.uint8)])
