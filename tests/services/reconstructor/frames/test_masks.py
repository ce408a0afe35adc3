from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.frames.masks import mask_files, mask_of, prepare_masks, read_mask, shrink_mask


def image(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), pixels)


def half(width: int = 80, height: int = 60) -> np.ndarray:
    """The left half is ignored."""
    mask = np.full((height, width), 255, np.uint8)
    mask[:, : width // 2] = 0
    return mask


@pytest.fixture
def images(tmp_path: Path) -> Path:
    for name in ("a.jpg", "b.jpg"):
        image(tmp_path / "images" / name, np.full((60, 80, 3), 90, np.uint8))
    return tmp_path / "images"


def test_masks_are_found_by_colmaps_names_or_the_images_own(tmp_path: Path, images: Path) -> None:
    image(tmp_path / "m" / "a.jpg.png", half())
    image(tmp_path / "m" / "b.png", half())
    found = prepare_masks(tmp_path / "m", images, ["a.jpg", "b.jpg"], {}, tmp_path / "out")
    assert found == {"masked": 0.5, "notes": ["masks hide 50 % of the images in the mean"]}
    for name in ("a.jpg.png", "b.jpg.png"):
        np.testing.assert_array_equal(cv2.imread(str(tmp_path / "out" / name), cv2.IMREAD_UNCHANGED), half())
    assert mask_of(tmp_path / "m", ["c.jpg"]) is None


def test_masks_of_photos_have_the_photos_names_and_any_size_of_their_shape(tmp_path: Path, images: Path) -> None:
    for name in ("IMG_1.PNG", "IMG_2.PNG"):
        image(tmp_path / "m" / f"{name}.png", half(320, 240))
    photos = {"IMG_1.PNG": ("a.jpg", 0.5), "IMG_2.PNG": ("b.jpg", 0.5)}
    prepare_masks(tmp_path / "m", images, ["a.jpg", "b.jpg"], photos, tmp_path / "out")
    np.testing.assert_array_equal(read_mask(tmp_path / "out" / "b.jpg.png"), half())


def test_all_but_zero_counts_in_masks_of_any_kind(tmp_path: Path) -> None:
    image(tmp_path / "grey.png", np.array([[0, 1], [255, 0]], np.uint8))
    image(tmp_path / "colour.png", np.array([[[0, 0, 0], [0, 9, 0]], [[1, 1, 1], [0, 0, 0]]], np.uint8))
    image(tmp_path / "alpha.png", np.array([[[0, 0, 0, 255], [9, 9, 9, 0]], [[1, 1, 1, 1], [0, 0, 0, 0]]], np.uint8))
    for name in ("grey", "colour", "alpha"):
        np.testing.assert_array_equal(read_mask(tmp_path / f"{name}.png"), [[0, 255], [255, 0]])
    (tmp_path / "broken.png").write_bytes(b"no image")
    assert read_mask(tmp_path / "broken.png") is None
    assert read_mask(tmp_path / "gone.png") is None


def test_reduced_pixels_count_where_all_of_them_did() -> None:
    mask = np.full((4, 6), 255, np.uint8)
    mask[3, 0] = 0
    np.testing.assert_array_equal(shrink_mask(mask, (3, 2)), [[255, 255, 255], [0, 255, 255]])
    assert shrink_mask(mask, (6, 4)) is mask


def test_missing_wrong_and_broken_masks_are_one_line_each(tmp_path: Path, images: Path) -> None:
    image(tmp_path / "m" / "a.jpg.png", half())
    with pytest.raises(SceneError, match=r"m has no mask of 1 of 2 images, b\.jpg\.png among them"):
        prepare_masks(tmp_path / "m", images, ["a.jpg", "b.jpg"], {}, tmp_path / "out")
    image(tmp_path / "m" / "b.jpg.png", half(60, 80))
    with pytest.raises(SceneError, match=r"b\.jpg\.png is 60x80 px, its image b\.jpg 80x60 px"):
        prepare_masks(tmp_path / "m", images, ["a.jpg", "b.jpg"], {}, tmp_path / "out")
    (tmp_path / "m" / "b.jpg.png").write_bytes(b"no image")
    with pytest.raises(SceneError, match=r"b\.jpg\.png cannot be read as a mask"):
        prepare_masks(tmp_path / "m", images, ["a.jpg", "b.jpg"], {}, tmp_path / "out")
    for folder in (tmp_path / "none", images):
        with pytest.raises(SceneError, match="holds no masks; name them after their images"):
            mask_files(folder)


def test_masks_that_hide_nearly_all_are_refused(tmp_path: Path, images: Path) -> None:
    for name in ("a.jpg.png", "b.jpg.png"):
        mask = np.zeros((60, 80), np.uint8)
        mask[:5] = 255
        image(tmp_path / "m" / name, mask)
    with pytest.raises(SceneError, match="hides 92 % of the images in the mean: too little is left"):
        prepare_masks(tmp_path / "m", images, ["a.jpg", "b.jpg"], {}, tmp_path / "out")


def test_masks_that_hide_most_are_doubted(tmp_path: Path, images: Path) -> None:
    for name in ("a.jpg.png", "b.jpg.png"):
        mask = np.zeros((60, 80), np.uint8)
        mask[:20] = 255
        image(tmp_path / "m" / name, mask)
    (note,) = prepare_masks(tmp_path / "m", images, ["a.jpg", "b.jpg"], {}, tmp_path / "out")["notes"]
    assert note == "masks hide 67 % of the images in the mean: check that 0 stands for what is to be ignored"
