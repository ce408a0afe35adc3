import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.capture.config import CaptureConfig
from readygo.apps.capture.film import Filming, check_out, film, ground_of, pictures, plan_filming
from readygo.apps.capture.truth import read_truth
from readygo.common.errors import ConfigError, ReadygoError, SceneError
from readygo.runs.scene_argument import open_scene


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
    corners_m = np.array(truth.content["marker"]["corners_m"])
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


def test_truth_says_how_it_was_filmed_and_every_photo_is_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = np.full((120, 160, 3), (200, 90, 20), np.uint8)
    monkeypatch.setattr("readygo.apps.capture.film.pictures", lambda plan: iter([plain] * plan.config.frames))
    plan, heard = filming(photos=True, fps=3, seed=5, sub_frames=4, marker_id=3, marker_size_m=0.15), list[int]()
    content = read_truth(film(plan, tmp_path / "photos", heard.append)).content
    assert heard == [1, 2, 3, 4, 5, 6]
    camera = plan.camera
    assert content["camera"] == {
        "model": "OPENCV",
        **{"fx": camera.fx_px, "fy": camera.fy_px, "cx": camera.cx_px, "cy": camera.cy_px},
        **{"k1": camera.k1, "k2": camera.k2, "p1": camera.p1, "p2": camera.p2},
    }
    assert {name: content[name] for name in ("seed", "fps", "seconds", "width_px", "height_px", "metres_per_unit")} == {
        "seed": 5, "fps": 3, "seconds": 2.0, "width_px": 160, "height_px": 120, "metres_per_unit": 1.0,
    }  # fmt: skip
    assert content["scene"]["hash"] == plan.scene.content_hash
    middle_s = 0.5 * (0.010 + 0.015)
    for number, row in enumerate(content["frames"]):
        time_s = (number + 0.5) / 3 - middle_s
        assert row["time_s"] == pytest.approx(time_s, abs=1e-6)
        np.testing.assert_array_equal(row["T_world_camera"], plan.walk.pose_at((number + 0.5) / 3 - middle_s))
    assert plan.marker is not None
    assert content["marker"] == {
        "id": 3, "dictionary": "4X4_50", "size_m": 0.15, "corners_m": plan.marker.corners_m.tolist(),
    }  # fmt: skip
    blue_first = cv2.imread(str(tmp_path / "photos" / "0002.jpg"))
    assert np.abs(blue_first[..., ::-1].astype(int).mean(axis=(0, 1)) - plain.mean(axis=(0, 1))).max() < 2


def test_exposure_wanders_within_a_quarter_stop_in_films_and_counts_in_pictures() -> None:
    plan = filming(seconds=30.0)
    assert 0.1 < np.abs(plan.exposures_ev).max() <= 0.25
    np.testing.assert_allclose(filming(seconds=30.0, exposure_ev=1.0).exposures_ev, 4.0 * plan.exposures_ev)
    low, high = (
        next(pictures(dataclasses.replace(plan, exposures_ev=np.full(60, stops)))).astype(float).mean()
        for stops in (-0.5, 0.5)
    )
    assert high > low + 20


def test_marker_gets_the_first_page_that_holds_it() -> None:
    small, large = filming(marker_size_m=0.2).marker, filming(marker_size_m=0.3).marker
    assert small is not None
    assert large is not None
    pages = [sorted((marker.sheet.width_m, marker.sheet.height_m)) for marker in (small, large)]
    np.testing.assert_allclose(pages, [(0.297, 0.42), (0.42, 0.594)], atol=1e-3)


def test_place_to_film_is_a_rectangle_with_a_positive_side_or_a_circle() -> None:
    scene = open_scene("embedded")
    for crop in ((0.0, 0.0, 0.0, 2.0), (0.0, 1.0, 2.0, 1.0)):
        with pytest.raises(ConfigError, match="X0 < X1"):
            ground_of(scene, crop, None, 3.0)
    with pytest.raises(ConfigError, match="--radius must be positive, got nan"):
        ground_of(scene, None, None, float("nan"))


def test_loop_that_is_walked_once_is_closed() -> None:
    plan = filming()
    walks = [dataclasses.replace(plan.walk, way_m=way_m, loop_m=7.0) for way_m in (5.2, 7.0)]
    words, none = (dataclasses.replace(plan, walk=walk).notes for walk in walks)
    assert words[0].startswith("the walk of 5.2 m does not close its loop of 7.0 m; --seconds 16 does")
    assert none == []


def test_people_walk_through_the_film_and_their_masks_lie_beside_it(tmp_path: Path) -> None:
    plan = filming(people=1, photos=True, marker_size_m=0.0, seconds=4.0, fps=1)
    truth = read_truth(film(plan, tmp_path / "photos", lambda done: None))
    assert truth.content["people"] == [plan.people[0].avatar]
    names = [path.name for path in sorted((tmp_path / "photos").iterdir())]
    assert sorted(path.name for path in (tmp_path / "photos.masks").iterdir()) == [f"{name}.png" for name in names]
    bare = [np.asarray(rgb, dtype=np.int64) for rgb in pictures(dataclasses.replace(plan, people=(), avatars={}))]
    hidden = 0
    for name, without in zip(names, bare, strict=True):
        mask = cv2.imread(str(tmp_path / "photos.masks" / f"{name}.png"), cv2.IMREAD_UNCHANGED)
        shown = cv2.imread(str(tmp_path / "photos" / name))[:, :, ::-1].astype(np.int64)
        changed = np.abs(shown - without).max(axis=2) > 60
        assert set(np.unique(mask)) <= {0, 255}
        assert not (changed & (mask > 0)).any(), "people are masked with their edges"
        hidden += int((mask == 0).sum())
    assert hidden > 200
    with pytest.raises(SceneError, match=r"photos\.masks exists already"):
        check_out(tmp_path / "photos", plan.config)


def test_film_without_people_is_what_it_was() -> None:
    assert filming().people == ()
    with pytest.raises(ConfigError, match="0 to 8 people"):
        CaptureConfig(people=9)
    with pytest.raises(ConfigError, match="People move at 20 Hz"):
        CaptureConfig(people=1, fps=30)


def test_film_of_360_degrees_has_the_phone_camera_view_in_its_middle(tmp_path: Path) -> None:
    plan = filming(equirectangular=True, width_px=256, height_px=128, photos=True)
    truth = read_truth(film(plan, tmp_path / "round", lambda done: None))
    assert (truth.content["camera"], truth.content["width_px"]) == ({"model": "EQUIRECTANGULAR"}, 256)
    image = cv2.imread(str(tmp_path / "round" / "0003.jpg"))
    assert image is not None
    assert image.shape == (128, 256, 3)
    plain = list(pictures(filming(photos=True)))[3][:, :, ::-1]
    # The phone looks 68 deg along its width, a fifth of the panorama's; its frames have the same times.
    middle = cv2.resize(image[45:83, 104:152], (160, 120), interpolation=cv2.INTER_AREA)
    alike = np.corrcoef(cv2.blur(middle, (9, 9)).ravel(), cv2.blur(np.ascontiguousarray(plain), (9, 9)).ravel())
    assert alike[0, 1] > 0.9
