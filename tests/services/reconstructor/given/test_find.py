import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.given.find import prepare_capture, read_capture
from tests.services.reconstructor.given import test_polycam, test_record3d
from tests.services.reconstructor.given.known import write_images
from tests.services.reconstructor.given.test_depth import png, slope_mm
from tests.services.reconstructor.given.test_transforms import FRAMES, LENS, written


def transforms(folder: Path, count: int = 4) -> Path:
    folder.mkdir(exist_ok=True)
    write_images(folder / "images", [f"{row}.png" for row in range(count)])
    written(folder, {**LENS, "frames": FRAMES})
    return folder


def test_kinds_are_told_apart(tmp_path: Path) -> None:
    test_record3d.export(tmp_path / "r")
    folders = [transforms(tmp_path / "t"), test_polycam.export(tmp_path / "p"), tmp_path / "r"]
    kinds = [capture.kind for folder in folders if (capture := read_capture(folder)) is not None]
    assert kinds == ["transforms.json", "Polycam", "Record3D"]
    given = read_capture(tmp_path / "t" / "transforms.json")
    assert given is not None
    assert given.files == (tmp_path / "t" / "transforms.json",)
    assert read_capture(tmp_path) is None
    (tmp_path / "v.mp4").touch()
    assert read_capture(tmp_path / "v.mp4") is None


def test_images_are_written_with_their_poses_and_lenses(tmp_path: Path) -> None:
    given = read_capture(transforms(tmp_path / "t"))
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig())
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(found["lens"]) == sorted(found["pose"])
    assert (found["kept"], found["size_px"], found["metric"], found["what"]) == (4, [80, 60], False, "transforms.json")
    assert found["lens"]["2.jpg"][:3] == ["OPENCV", 60.0, 62.0]
    np.testing.assert_allclose(found["pose"]["2.jpg"], given.T_world_camera[2])
    assert json.loads(json.dumps(found))["pose"] == found["pose"], "the report is JSON"


def test_smaller_images_have_smaller_lenses_and_are_not_turned(tmp_path: Path) -> None:
    folder = transforms(tmp_path / "t")
    write_images(folder / "images", [f"{row}.png" for row in range(4)], (800, 600))
    given = read_capture(folder)
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig(side_max_px=400))
    assert cv2.imread(str(tmp_path / "out" / "0.jpg")).shape == (300, 400, 3)
    assert found["lens"]["0.jpg"][1:5] == [300.0, 310.0, 205.0, 145.0]
    assert found["photos"]["0.png"] == ("0.jpg", 0.5)


def test_missing_images_are_left_out_and_told(tmp_path: Path) -> None:
    given = read_capture(transforms(tmp_path / "t", 3))
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig())
    assert (found["kept"], found["notes"]) == (3, ["1 of 4 images of the transforms.json are missing"])
    (tmp_path / "t" / "images" / "1.png").write_bytes(b"no image")
    with pytest.raises(SceneError, match=r"2 images of this transforms\.json are there; 3 are needed"):
        prepare_capture(given, tmp_path / "again", FramesConfig())


def test_images_of_another_shape_than_their_lens_are_refused(tmp_path: Path) -> None:
    folder = transforms(tmp_path / "t")
    write_images(folder / "images", ["1.png"], (60, 80))
    given = read_capture(folder)
    assert given is not None
    with pytest.raises(SceneError, match=r"1\.png is 60x80 px, its lens is for 80x60 px"):
        prepare_capture(given, tmp_path / "out", FramesConfig())


def test_more_images_than_wanted_are_taken_evenly(tmp_path: Path) -> None:
    given = read_capture(transforms(tmp_path / "t"))
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig(count_max=3))
    assert sorted(found["lens"]) == ["0.jpg", "2.jpg", "3.jpg"]


def test_names_that_repeat_take_their_folder_along(tmp_path: Path) -> None:
    frames = [{**frame, "file_path": f"cam{row % 2}/{row // 2}.png"} for row, frame in enumerate(FRAMES)]
    for camera in range(2):
        write_images(tmp_path / f"cam{camera}", ["0.png", "1.png"])
    written(tmp_path, {**LENS, "frames": frames})
    given = read_capture(tmp_path)
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig())
    assert sorted(found["lens"]) == ["cam0/0.jpg", "cam0/1.jpg", "cam1/0.jpg", "cam1/1.jpg"]
    assert (tmp_path / "out" / "cam1" / "0.jpg").is_file()


def test_images_of_a_folder_above_are_written_below_the_output(tmp_path: Path) -> None:
    places = [f"cam{row % 2}/more/../{row // 2}.png" for row in range(len(FRAMES))]
    frames = [{**frame, "file_path": place} for frame, place in zip(FRAMES, places, strict=True)]
    for camera in range(2):
        write_images(tmp_path / f"cam{camera}", ["0.png", "1.png"])
        (tmp_path / f"cam{camera}" / "more").mkdir()
    written(tmp_path, {**LENS, "frames": frames})
    given = read_capture(tmp_path)
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig())
    assert sorted(found["lens"]) == ["cam0/0.jpg", "cam0/1.jpg", "cam1/0.jpg", "cam1/1.jpg"]


def test_images_have_no_spaces_in_their_names_and_files_keep_theirs(tmp_path: Path) -> None:
    frames = [{**frame, "file_path": f"images/IMG {row}.png"} for row, frame in enumerate(FRAMES)]
    write_images(tmp_path / "images", [f"IMG {row}.png" for row in range(4)])
    written(tmp_path, {**LENS, "frames": frames})
    given = read_capture(tmp_path)
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig())
    assert found["photos"]["IMG 2.png"] == ("IMG_2.jpg", 1.0)
    assert sorted(found["pose"]) == sorted(path.name for path in (tmp_path / "out").iterdir())
    assert "IMG_2.jpg" in found["pose"]


def test_images_whose_names_become_the_same_are_refused(tmp_path: Path) -> None:
    names = ["a b.png", "a_b.png", "c.png", "d.png"]
    frames = [{**frame, "file_path": f"images/{name}"} for name, frame in zip(names, FRAMES, strict=True)]
    write_images(tmp_path / "images", names)
    written(tmp_path, {**LENS, "frames": frames})
    given = read_capture(tmp_path)
    assert given is not None
    with pytest.raises(SceneError, match="names differ in endings or spaces only; rename them"):
        prepare_capture(given, tmp_path / "out", FramesConfig())


def test_files_whose_names_repeat_are_named_from_the_folder_of_the_capture_on(tmp_path: Path) -> None:
    names = ["left/../left/0.png", "right/0.png", "left/1.png", "right/2.png"]
    frames = [{**frame, "file_path": f"images/{name}"} for name, frame in zip(names, FRAMES, strict=True)]
    write_images(tmp_path / "images" / "left", ["0.png", "1.png"])
    write_images(tmp_path / "images" / "right", ["0.png", "2.png"])
    written(tmp_path, {**LENS, "frames": frames})
    given = read_capture(tmp_path)
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig())
    assert {name: image for name, (image, _) in found["photos"].items()} == {
        "images/left/0.png": "left/0.jpg", "images/right/0.png": "right/0.jpg", "1.png": "left/1.jpg",
        "2.png": "right/2.jpg",
    }  # fmt: skip


def test_image_with_two_poses_is_named(tmp_path: Path) -> None:
    capture = transforms(tmp_path / "t")
    frames = [*FRAMES[:3], {**FRAMES[3], "file_path": f"images/../{FRAMES[0]['file_path']}"}]
    written(capture, {**LENS, "frames": frames})
    given = read_capture(capture)
    assert given is not None
    with pytest.raises(SceneError, match=r"transforms\.json has 1 images twice or more, 0\.png among them"):
        prepare_capture(given, tmp_path / "out", FramesConfig())
    assert not (tmp_path / "out").exists()


def test_depth_images_are_written_beside_the_images_unless_they_are_not_wanted(tmp_path: Path) -> None:
    folder = test_polycam.export(tmp_path / "p")
    for row in range(3):
        png(folder / "keyframes" / "depth" / f"100{row}.png", slope_mm())
    given = read_capture(folder)
    assert given is not None
    found = prepare_capture(given, tmp_path / "out", FramesConfig())
    assert (found["depths"], found["notes"]) == (3, ["depth images of 1 of 4 images are missing, broken or empty"])
    names = sorted(path.name for path in (tmp_path / "out" / "depth").iterdir())
    assert names == ["1000.jpg.png", "1001.jpg.png", "1002.jpg.png"]
    found = prepare_capture(given, tmp_path / "without", FramesConfig(depth=False))
    assert (found["depths"], found["notes"]) == (0, [])
    assert not (tmp_path / "without" / "depth").exists()
