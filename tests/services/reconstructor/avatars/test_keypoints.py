"""Keypoints of both sets are read and written; those of no person, or of another one than the masks, are refused."""

from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import AvatarError
from readygo.services.reconstructor.avatars.keypoints import (
    ANCHORS,
    COCO17,
    HALPE26,
    Keypoints,
    check_keypoints,
    mirror_name,
    read_keypoints,
    write_keypoints,
)

IMAGES = tuple(f"{number:05d}.png" for number in range(8))


def _keypoints(names: tuple[str, ...] = HALPE26) -> Keypoints:
    rng = np.random.default_rng(0)
    uv = rng.uniform(20.0, 80.0, (len(IMAGES), len(names), 2)).astype(np.float32).astype(np.float64)
    return Keypoints(names=names, uv_px=uv, confidence=np.full(uv.shape[:2], 0.5))


def _masks() -> list[np.ndarray]:
    mask = np.zeros((100, 100), dtype=bool)
    mask[15:85, 15:85] = True
    return [mask] * len(IMAGES)


def test_file_keeps_keypoints_in_the_order_of_the_images(tmp_path: Path) -> None:
    for names in (COCO17, HALPE26):
        keypoints = _keypoints(names)
        write_keypoints(tmp_path / "keypoints.npz", keypoints, IMAGES[::-1])
        found = read_keypoints(tmp_path / "keypoints.npz", IMAGES)
        assert found.names == names
        np.testing.assert_array_equal(found.uv_px, keypoints.uv_px[::-1])


def test_other_counts_frames_and_confidences_are_refused(tmp_path: Path) -> None:
    path, rows = tmp_path / "keypoints.npz", np.full((8, 17, 3), 0.5)
    np.savez(path, keypoints=np.zeros((8, 25, 3)))
    with pytest.raises(AvatarError, match=r"K = 17 or 26 \(COCO, Halpe with feet\), got \(8, 25, 3\)"):
        read_keypoints(path, IMAGES)
    np.savez(path, keypoints=rows[:7])
    with pytest.raises(AvatarError, match="keypoints of 7 frames, but 8 images"):
        read_keypoints(path, IMAGES)
    np.savez(path, keypoints=rows, images=np.array([*IMAGES[:-1], "other.png"]))
    with pytest.raises(AvatarError, match=r"lacks the keypoints of 1 of 8 images, 00007\.png"):
        read_keypoints(path, IMAGES)
    np.savez(path, keypoints=rows * 300.0)
    with pytest.raises(AvatarError, match=r"confidences must be 0\.\.1"):
        read_keypoints(path, IMAGES)
    np.savez(path, points=rows)
    with pytest.raises(AvatarError, match="lacks keypoints"):
        read_keypoints(path, IMAGES)


def test_text_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "keypoints.npz", keypoints=np.full((8, 17, 3), "a"))
    with pytest.raises(AvatarError, match="keypoints must hold numbers, got values of <U1"):
        read_keypoints(tmp_path / "keypoints.npz", IMAGES)


@pytest.mark.parametrize("far_px", [np.nan, np.inf, -1e200, 1e6])
def test_what_is_not_finite_or_far_from_images_is_not_seen(tmp_path: Path, far_px: float) -> None:
    rows = np.full((8, 17, 3), 0.5)
    rows[..., 0] = 9000.0
    rows[3, 2, 0] = far_px
    np.savez(tmp_path / "keypoints.npz", keypoints=rows)
    seen = read_keypoints(tmp_path / "keypoints.npz", IMAGES).seen
    assert not seen[3, 2]
    assert seen.sum() == seen.size - 1


def test_sides_are_exchanged_where_asked() -> None:
    keypoints, swapped = _keypoints(), np.zeros((8, 26), dtype=bool)
    swapped[2] = True
    found = keypoints.with_swapped(swapped)
    left, right = HALPE26.index("left_knee"), HALPE26.index("right_knee")
    np.testing.assert_array_equal(found.uv_px[2, [left, right]], keypoints.uv_px[2, [right, left]])
    np.testing.assert_array_equal(found.uv_px[3], keypoints.uv_px[3])


def test_anchors_are_mirrored() -> None:
    assert set(ANCHORS) >= set(HALPE26)
    for name, anchor in ANCHORS.items():
        other = ANCHORS[mirror_name(name)]
        assert other.offset_m == (-anchor.offset_m[0], *anchor.offset_m[1:])


def test_persons_who_do_not_fit_the_masks_are_refused() -> None:
    keypoints, source = _keypoints(), Path("keypoints.npz")
    assert check_keypoints(keypoints, _masks(), IMAGES, source) == []
    beside = [np.roll(mask, 60, axis=1) for mask in _masks()]
    with pytest.raises(AvatarError, match=r"covers less than 60 % of the keypoints, 00000\.png"):
        check_keypoints(keypoints, beside, IMAGES, source)
    keypoints.confidence[:3] = 0.1
    with pytest.raises(AvatarError, match="3 of 8 frames have fewer than 5 keypoints"):
        check_keypoints(keypoints, _masks(), IMAGES, source)


def test_keypoints_beside_the_mask_by_a_small_share_of_its_height_are_of_the_same_person() -> None:
    keypoints, source = _keypoints(), Path("keypoints.npz")
    for offset_px, fits in ((2.0, True), (6.0, False)):
        keypoints.uv_px[..., 0], keypoints.uv_px[..., 1] = 50.0, 85.0 + offset_px
        if fits:
            assert check_keypoints(keypoints, _masks(), IMAGES, source) == []
        else:
            with pytest.raises(AvatarError, match="covers less than 60 %"):
                check_keypoints(keypoints, _masks(), IMAGES, source)


def test_videos_without_ankles_are_refused_and_without_toes_told() -> None:
    keypoints, source = _keypoints(), Path("keypoints.npz")
    keypoints.confidence[:, 20:] = 0.0
    assert "directions of the feet are guessed" in check_keypoints(keypoints, _masks(), IMAGES, source)[0]
    keypoints.confidence[:, 15:17] = 0.0
    with pytest.raises(AvatarError, match="the ankles are seen in less than 20 %"):
        check_keypoints(keypoints, _masks(), IMAGES, source)
