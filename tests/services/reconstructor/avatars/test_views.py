"""Frames are cut out around the person; masks without exactly one whole person are refused."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import AvatarError
from readygo.services.reconstructor.avatars import views
from readygo.services.reconstructor.avatars.footage import read_footage
from readygo.services.reconstructor.avatars.views import (
    PersonMask,
    band_px,
    read_masks,
    read_person,
    read_rgb,
    view_at,
)
from tests.services.reconstructor.frames.test_exif import exif


def _repaint(folder: Path, change: "np.ufunc | object") -> None:
    for path in sorted((folder / "masks").iterdir()):
        cv2.imwrite(str(path), change(cv2.imread(str(path))))  # type: ignore[operator]


def test_cut_out_has_the_person_and_its_camera(plain_film: Path) -> None:
    footage = read_footage(plain_film)
    person = read_person(footage, 512)
    view = view_at(person, 0, 1)
    assert view.rgb.shape == (3, *view.mask.shape)
    assert view.mask.shape[1] < 96
    whole = cv2.imread(str(footage.masks[0]))[:, :, 0] > 127
    assert view.mask.sum() == whole.sum()
    left, top = footage.K_px[0, :2, 2] - view.K_px[:2, 2]
    rows, columns = np.nonzero(whole)
    inside = np.nonzero(view.mask)
    assert (inside[0] + int(top) == rows).all()
    assert (inside[1] + int(left) == columns).all()
    half = view_at(person, 0, 2)
    assert half.K_px[0, 0] == pytest.approx(0.5 * view.K_px[0, 0], rel=0.03)
    assert half.mask.mean() == pytest.approx(view.mask.mean(), rel=0.03)
    assert not half.inner[(half.mask > 0.1) & (half.mask < 0.9)].any()


def test_large_images_are_made_smaller(plain_film: Path) -> None:
    footage = read_footage(plain_film)
    small, large = (view_at(read_person(footage, side), 0, 1) for side in (48, 96))
    assert small.mask.shape[0] == pytest.approx(0.5 * large.mask.shape[0], abs=1)
    assert small.K_px[0, 0] == pytest.approx(0.5 * large.K_px[0, 0], rel=0.03)


def test_masks_with_a_black_person_are_read_alike(own_film: Path) -> None:
    before = read_person(read_footage(own_film), 512)
    _repaint(own_film, lambda mask: 255 - mask)
    after = read_person(read_footage(own_film), 512)
    assert all((one == other).all() for one, other in zip(before.mask, after.mask, strict=True))


def test_masks_without_one_whole_person_are_refused(own_film: Path) -> None:
    footage = read_footage(own_film)

    def two(mask: np.ndarray) -> np.ndarray:
        both = np.zeros_like(mask)
        both[:, :48] = np.roll(mask, -24, axis=1)[:, :48]
        return both | both[:, ::-1]

    original = {path: cv2.imread(str(path)) for path in footage.masks}
    cases = [
        (lambda mask: 0 * mask, "masks are empty"),
        (lambda mask: 0 * mask + 255, r"12 of 12 masks are white all over, 00000\.png among them: they show the whole"),
        (two, "show two people"),
        (lambda mask: np.roll(mask, 40, axis=0) * (np.arange(96) >= 30)[:, None, None], "without feet"),
        (lambda mask: mask[:80], "its image 96x96 px"),
        (lambda mask: cv2.resize(cv2.resize(mask, (20, 20)), (96, 96)) * 0 + _small(mask), "too little to see"),
    ]
    for change, words in cases:
        for path, mask in original.items():
            cv2.imwrite(str(path), np.asarray(change(mask), dtype=np.uint8))
        with pytest.raises(AvatarError, match=words):
            read_person(footage, 512)


def test_single_empty_mask_is_named(own_film: Path) -> None:
    footage = read_footage(own_film)
    cv2.imwrite(str(footage.masks[4]), np.zeros((96, 96, 3), np.uint8))
    with pytest.raises(AvatarError, match=r"00004\.png shows no one"):
        read_person(footage, 512)


def test_single_white_mask_is_named(own_film: Path) -> None:
    footage = read_footage(own_film)
    cv2.imwrite(str(footage.masks[4]), np.full((96, 96, 3), 255, np.uint8))
    with pytest.raises(AvatarError, match=r"1 of 12 masks are white all over, 00004\.png among them"):
        read_person(footage, 512)


def test_broken_image_is_named(own_film: Path) -> None:
    footage = read_footage(own_film)
    footage.images[1].write_bytes(b"no image")
    with pytest.raises(AvatarError, match=r"00001\.png cannot be read as an image"):
        read_person(footage, 512)


def _small(mask: np.ndarray) -> np.ndarray:
    out = np.zeros_like(mask)
    out[30:50, 30:50] = 255
    return out


def test_masks_are_sure_everywhere_but_near_their_borders_before_a_plate(plain_film: Path) -> None:
    person = read_person(read_footage(plain_film), 512)
    assert view_at(person, 0, 1).plate is None
    assert (view_at(person, 0, 1).sure == 1.0).all()
    plates = tuple(np.full_like(rgb, 51) for rgb in person.rgb)
    before = view_at(replace(person, plates=plates), 0, 1)
    assert before.plate is not None
    np.testing.assert_allclose(before.plate, 0.2, atol=1e-6)
    distances = [
        cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for part in (person.mask[0], ~person.mask[0])
    ]
    to_border = np.maximum(*distances)
    band = band_px(person.mask[0])
    assert band == 2
    assert not before.sure[to_border < band].any()
    assert before.sure[to_border > band + 1].all()
    half = view_at(replace(person, plates=plates), 0, 2)
    assert half.plate is not None
    assert half.plate.shape[1:] == half.sure.shape == half.mask.shape
    assert set(np.unique(half.sure)) == {0.0, 1.0}


@pytest.mark.parametrize("orientation", [3, 6])
def test_images_are_read_as_they_lie_in_the_file_and_exif_does_not_turn_them(tmp_path: Path, orientation: int) -> None:
    pixels = np.zeros((36, 48, 3), np.uint8)
    pixels[:, 36:] = 255
    data = cv2.imencode(".jpg", pixels)[1].tobytes()
    (tmp_path / "a.jpg").write_bytes(exif("<", orientation, 26) + data[2:])
    rgb = read_rgb(tmp_path / "a.jpg", "image")
    assert rgb[:, :30].max() < 50
    assert rgb[:, 42:].min() > 200


def test_part_of_a_mask_around_the_person_is_kept_and_gives_the_whole_one_back() -> None:
    mask = np.zeros((300, 200), dtype=bool)
    mask[150:300, 90:120] = True
    kept = PersonMask.of_whole(mask)
    assert kept.cut.size < 0.5 * mask.size
    np.testing.assert_array_equal(kept.whole(), mask)
    assert kept.is_cut_off
    mask[299] = False
    assert not PersonMask.of_whole(mask).is_cut_off
    nothing = PersonMask.of_whole(np.zeros((30, 20), dtype=bool))
    assert nothing.whole().shape == (30, 20)


def test_single_mask_of_the_other_kind_is_taken_as_the_others_are(own_film: Path) -> None:
    footage = read_footage(own_film)
    cv2.imwrite(str(footage.masks[2]), 255 - cv2.imread(str(footage.masks[2])))
    masks, _ = read_masks(footage.masks, footage.sizes_px)
    for path, mask in zip(footage.masks, masks, strict=True):
        np.testing.assert_array_equal(mask.whole(), cv2.imread(str(path))[:, :, 0] > 127)


def test_frames_are_held_small_where_photos_are_large(plain_film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    footage, side = read_footage(plain_film), 768
    large = replace(footage, sizes_px=np.full_like(footage.sizes_px, side))

    def read_large(path: Path, what: str) -> np.ndarray:
        pixels = np.zeros((side, side, 3), dtype=np.uint8)
        pixels[60:720, 60:720] = 255
        return pixels

    monkeypatch.setattr(views, "read_rgb", read_large)
    tracemalloc.start()
    person = read_person(large, 96)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert max(rgb.shape[0] for rgb in person.rgb) <= 96
    # Of the photos one is held at its size, of the masks all, a byte a pixel.
    assert peak_bytes < len(person) * side**2 + 6 * 3 * side**2
