"""Films are written whole, at the simulation's pace, or not at all."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.pictures.film import write_film
from readygo.common.errors import ReadygoError


@pytest.mark.parametrize("name", ["film.webm", "film.mp4"])
def test_film_plays_back_with_all_pictures(tmp_path: Path, name: str) -> None:
    pictures = [np.full((48, 64, 3), 10 * k, np.uint8) for k in range(10)]
    write_film(tmp_path / "new" / name, pictures)
    capture = cv2.VideoCapture(str(tmp_path / "new" / name))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(20.0)
    levels = []
    while (read := capture.read())[0]:
        levels.append(float(read[1].mean()))
    np.testing.assert_allclose(levels, np.arange(10) * 10, atol=8)
    assert [path.name for path in (tmp_path / "new").iterdir()] == [name]


def test_missing_encoders_leave_no_file_and_no_noise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("readygo.apps.pictures.film.CODECS", {".mp4": ("none",)})
    with pytest.raises(ReadygoError, match="cannot write videos"):
        write_film(tmp_path / "film.mp4", [np.zeros((48, 64, 3), np.uint8)])
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_film_is_in_a_format_that_browsers_play(tmp_path: Path) -> None:
    pictures = [np.zeros((48, 64, 3), np.uint8)] * 2
    for name, codecs in (("film.webm", {"VP80"}), ("film.mp4", {"avc1", "h264", "vp09", "VP90"})):
        write_film(tmp_path / name, pictures)
        number = int(cv2.VideoCapture(str(tmp_path / name)).get(cv2.CAP_PROP_FOURCC))
        assert number.to_bytes(4, "little").decode() in codecs
    with pytest.raises(ReadygoError, match=r"film.avi must end in \.webm or \.mp4"):
        write_film(tmp_path / "film.avi", pictures)


def test_folder_that_cannot_be_made_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ReadygoError, match="cannot be written"):
        write_film(tmp_path / "file" / "film.mp4", [np.zeros((48, 64, 3), np.uint8)])


def test_film_that_is_cut_short_is_no_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        """Writes to a disk that is full after a while."""

        def __init__(self, path: str, *arguments: object) -> None:
            self.path, self.writer = Path(path), whole(path, *arguments)

        def __getattr__(self, name: str) -> object:
            return getattr(self.writer, name)

        def release(self) -> None:
            self.writer.release()
            os.truncate(self.path, self.path.stat().st_size // 2)

    whole = cv2.VideoWriter
    monkeypatch.setattr(cv2, "VideoWriter", Full)
    Full.fourcc = staticmethod(whole.fourcc)
    noise = np.random.default_rng(0).integers(0, 255, (20, 48, 64, 3), np.uint8)
    with pytest.raises(ReadygoError, match=r"of 20 pictures are in it\. Is the disk full"):
        write_film(tmp_path / "film.webm", list(noise))
    assert list(tmp_path.iterdir()) == []
