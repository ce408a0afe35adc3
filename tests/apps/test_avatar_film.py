"""The film of a walk: people stand on the floor's lines, and it plays back."""

import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest

from apps.avatar_film import AMPLITUDE_M, HEIGHT_PX, LENGTH_M, WIDTH_PX, s_curve_walk, walk_frames, write_film
from common.avatars import Avatar, load_avatars
from common.errors import ReadygoError


@pytest.fixture(scope="module")
def person() -> Avatar:
    return next(iter(load_avatars().values()))


def test_walk_follows_the_s_curve_to_its_end(person: Avatar) -> None:
    root = s_curve_walk(person).root_m
    sway = AMPLITUDE_M * np.sin(2 * np.pi * root[:, 0] / LENGTH_M)
    assert np.abs(root[:, 1] - sway).max() < 0.05
    assert root[-1, 0] == pytest.approx(LENGTH_M, abs=0.1)


def test_pictures_show_the_person_before_wall_and_floor(person: Avatar) -> None:
    first, *_, last = itertools.islice(walk_frames(person), 0, 12)
    assert first.shape == (HEIGHT_PX, WIDTH_PX, 3)
    wall = first[5, 5].astype(int)
    middle = first[:, WIDTH_PX // 4 : 3 * WIDTH_PX // 4].astype(int)
    person_rows = np.flatnonzero((np.abs(middle - wall).max(axis=2) > 100).any(axis=1))
    assert 0.3 * HEIGHT_PX < np.ptp(person_rows) < 0.95 * HEIGHT_PX
    lines = first[-5].astype(int).mean(axis=1)
    assert lines.min() < lines.max() - 30
    assert (first != last).any()


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
    monkeypatch.setattr("apps.avatar_film.CODECS", ("none",))
    with pytest.raises(ReadygoError, match="cannot write videos"):
        write_film(tmp_path / "film.mp4", [np.zeros((48, 64, 3), np.uint8)])
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""
