from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.frames.photos import prepare_photos
from tests.services.reconstructor.frames.test_exif import exif


def photo(path: Path, width: int = 640, height: int = 480, begin: bytes = b"") -> None:
    data = cv2.imencode(".jpg", np.full((height, width, 3), 99, np.uint8))[1].tobytes()
    path.write_bytes(begin + data[2:] if begin else data)


def test_photos_are_turned_and_made_smaller_and_their_focal_length_is_known(tmp_path: Path) -> None:
    source = tmp_path / "in"
    source.mkdir()
    for number in range(3):
        photo(source / f"{number}.jpg", begin=exif("<", 6, 26))
    (source / "broken.png").write_bytes(b"no image")
    found = prepare_photos(source, tmp_path / "out", FramesConfig(side_max_px=320))
    assert cv2.imread(str(tmp_path / "out" / "0.jpg")).shape == (320, 240, 3)
    assert (found["kept"], found["size_px"], found["unused"]) == (3, [240, 320], ["broken.png"])
    assert (found["source_px"], found["turned_deg"]) == ([480, 640], 90)
    assert abs(found["focal_px"] - 26 / 43.2666 * 400) < 0.1
    assert found["photos"] == {f"{number}.jpg": (f"{number}.jpg", 0.5) for number in range(3)}


def test_each_size_is_a_camera_of_its_own(tmp_path: Path) -> None:
    for number, size in enumerate([(640, 480), (640, 480), (480, 640)]):
        photo(tmp_path / f"{number}.jpg", *size)
    found = prepare_photos(tmp_path, tmp_path / "out", FramesConfig())
    assert found["size_px"] == [[480, 640], [640, 480]] or found["size_px"] == [[640, 480], [480, 640]]
    assert (tmp_path / "out" / "480x640" / "2.jpg").is_file()
    assert found["photos"]["2.jpg"] == ("480x640/2.jpg", 1.0)
    assert found["source_px"] is None


def test_picture_of_another_size_without_a_focal_length_is_left_out(tmp_path: Path) -> None:
    for number in range(3):
        photo(tmp_path / f"{number}.jpg", begin=exif("<", 1, 26))
    photo(tmp_path / "poster.jpg", 500, 300)
    photo(tmp_path / "upright.jpg", 480, 640, begin=exif("<", 1, 26))
    found = prepare_photos(tmp_path, tmp_path / "out", FramesConfig())
    assert (found["kept"], found["unused"]) == (4, ["poster.jpg"])
    assert found["focal_px"] > 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["480x640", "640x480"]


def test_pictures_of_another_size_stay_where_nothing_tells_them_from_photos(tmp_path: Path) -> None:
    for number in range(3):
        photo(tmp_path / f"{number}.jpg", begin=exif("<", 1, 26) if number else b"")
    photo(tmp_path / "other.jpg", 500, 300)
    found = prepare_photos(tmp_path, tmp_path / "out", FramesConfig())
    assert (found["kept"], found["unused"]) == (4, [])


def test_too_few_photos_are_refused(tmp_path: Path) -> None:
    photo(tmp_path / "a.jpg")
    with pytest.raises(SceneError, match="1 readable photos; 3 are needed"):
        prepare_photos(tmp_path, tmp_path / "out", FramesConfig())


def test_images_have_no_spaces_in_their_names_and_photos_keep_theirs(tmp_path: Path) -> None:
    for number, size in enumerate([(640, 480), (640, 480), (480, 640)]):
        photo(tmp_path / f"IMG {number} (1).jpg", *size)
    found = prepare_photos(tmp_path, tmp_path / "out", FramesConfig())
    assert found["photos"]["IMG 0 (1).jpg"] == ("640x480/IMG_0_(1).jpg", 1.0)
    assert found["photos"]["IMG 2 (1).jpg"] == ("480x640/IMG_2_(1).jpg", 1.0)
    assert (tmp_path / "out" / "480x640" / "IMG_2_(1).jpg").is_file()
    assert found["unused"] == []


@pytest.mark.parametrize("name", ["a_b.jpg", "a b.png"])
def test_photos_whose_names_become_the_same_are_refused(tmp_path: Path, name: str) -> None:
    for each in ("a b.jpg", name, "c.jpg"):
        photo(tmp_path / each)
    with pytest.raises(SceneError, match="names differ in endings or spaces only; rename them"):
        prepare_photos(tmp_path, tmp_path / "out", FramesConfig())
