import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.capture.config import CaptureConfig
from readygo.apps.capture.film import Filming, check_out, film, ground_of, pictures, plan_filming
from readygo.apps.capture.truth import read_truth
from readygo.apps.run.scene_argument import open_scene
from readygo.common.errors import ConfigError, ReadygoError, SceneError


def filming(**settings: object) -> Filming:
    scene = open_scene("embedded")
    config = CaptureConfig(**{"seconds": 2.0, "fps": 2, "width_px": 160, "height_px": 120, **settings})
    return plan_filming(scene, ground_of(scene, None, None, 2.5), config)


def test_pictures_show_the_marker_and_are_the_same_again() -> None:
    plan = filming()
    assert plan.marker is not None
    first, second = next(pictures(plan)), next(pictures(filming()))
    np.testing.assert_array_equal(first, second)
    bare = next(pictures(filming(marker_size_m=0.0)))
    changed = (np.abs(first.astype(int) - bare) > 40).any(axis=2)
    assert 20 < changed.sum() < 3000


def test_shutter_blurs(tmp_path: Path) -> None:
    sharp, blurred = (list(pictures(filming(sub_frames=count)))[-1] for count in (0, 2))
    assert np.abs(sharp.astype(int) - blurred).mean() > 0.5


def test_film_has_its_truth_beside_it(tmp_path: Path) -> None:
    done: list[int] = []
    truth = read_truth(film(filming(), tmp_path / "walk.mp4", done.append))
    assert done == [1, 2, 3, 4]
    video = cv2.VideoCapture(str(tmp_path / "walk.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == len(truth.poses) == 4
    corners_m = truth.marker_corners_m
    assert corners_m is not None
    np.testing.assert_allclose(np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=0), axis=1), 0.2, atol=1e-9)
    assert truth.content["camera"]["model"] == "OPENCV"
    assert len({row["exposure_ev"] for row in truth.content["frames"]}) == 4


def test_photos_are_files_of_one_exposure(tmp_path: Path) -> None:
    path = film(filming(photos=True), tmp_path / "photos", lambda done: None)
    names = sorted(file.name for file in (tmp_path / "photos").iterdir())
    assert names == ["0000.jpg", "0001.jpg", "0002.jpg", "0003.jpg"]
    content = json.loads(path.read_text())
    assert [row["image"] for row in content["frames"]] == names
    assert {row["exposure_ev"] for row in content["frames"]} == {0.0}


def test_loop_that_stays_open_is_said() -> None:
    assert "does not close its loop" in filming().notes[0]
    assert filming(seconds=40.0).notes == []


@pytest.mark.parametrize(
    ("crop", "start", "radius", "words"),
    [
        ((0.0, 0.0, 1.0, 1.0), (0.0, 0.0), 3.0, "either --crop"),
        ((1.0, 0.0, 0.0, 1.0), None, 3.0, "X0 < X1"),
        (None, None, 0.0, "--radius must be positive"),
    ],
)
def test_places_that_make_no_sense_are_refused(crop: object, start: object, radius: float, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        ground_of(open_scene("embedded"), crop, start, radius)


def test_names_that_cannot_be_written_are_refused_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"must end in \.webm or \.mp4"):
        check_out(tmp_path / "walk.gif", CaptureConfig())
    with pytest.raises(SceneError, match="new folder"):
        check_out(tmp_path, CaptureConfig(photos=True))


def test_marker_that_fits_no_sheet_is_refused() -> None:
    with pytest.raises(ReadygoError, match=r"is 0\.01 to"):
        filming(marker_size_m=2.0)
