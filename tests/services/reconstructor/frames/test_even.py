"""Frames are evenly spaced in time, and a background that moves is measured."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.services.reconstructor.frames.even import even_frames, extract_even_frames
from tests.services.reconstructor.frames.test_video import film, held_upright


@pytest.mark.parametrize(
    ("rate_hz", "count_max", "numbers", "taken_hz"),
    [
        (20.0, 99, range(0, 60, 2), 15.0),
        (30.0, 99, range(60), 30.0),
        (99.0, 99, range(60), 30.0),
        (30.0, 20, range(0, 60, 3), 10.0),
    ],
)
def test_constant_rate_is_divided(rate_hz: float, count_max: int, numbers: range, taken_hz: float) -> None:
    found, rate = even_frames(np.arange(60) / 30.0 + 0.4, rate_hz=rate_hz, count_max=count_max)
    assert found.tolist() == list(numbers)
    assert rate == pytest.approx(taken_hz)


def test_nearest_frames_are_taken_of_a_variable_rate() -> None:
    times_s = [0.0, 0.04, 0.08, 0.12, 0.15, 0.16, 0.2, 0.24, 0.28, 0.32]
    found, rate = even_frames(times_s, rate_hz=12.5, count_max=99)
    assert rate == pytest.approx(12.5)
    assert [times_s[number] for number in found] == pytest.approx([0.0, 0.08, 0.16, 0.24, 0.32])
    assert even_frames([0.0], rate_hz=20.0, count_max=9)[0].tolist() == [0]


def test_frames_are_written_at_their_size_and_the_background_is_followed(tmp_path: Path) -> None:
    film(tmp_path / "still.mp4", frames=30, step_px=0)
    held_upright(tmp_path / "still.mp4")
    found = extract_even_frames(tmp_path / "still.mp4", tmp_path / "images", rate_hz=5.0, count_max=99)
    assert found["numbers"] == list(range(0, 30, 2))
    assert (found["frames"], found["size_px"], found["turned_deg"], found["rate_hz"]) == (30, [120, 160], 90, 5.0)
    assert sorted(path.name for path in (tmp_path / "images").iterdir())[1] == "000002.jpg"
    assert cv2.imread(str(tmp_path / "images" / "000002.jpg")).shape == (160, 120, 3)
    assert found["moved"] < 0.002
    film(tmp_path / "moves.mp4", frames=30, step_px=1)
    assert extract_even_frames(tmp_path / "moves.mp4", tmp_path, rate_hz=5.0, count_max=99)["moved"] > 0.02
