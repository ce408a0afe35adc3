"""Photos of a posed model."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.drawing.files import write_png
from readygo.common.errors import SceneError
from readygo.services.reconstructor.training import photos
from readygo.services.reconstructor.training.photos import PhotoStore, open_posed, split_views, views_by_moment
from tests.services.reconstructor.frames.test_exif import exif
from tests.services.reconstructor.training.conftest import FOCAL_PX, SIZE_PX, VIEWS, rig_frames

Write = Callable[[Path], Path]


def test_model_is_read_with_its_cameras_and_points(write_posed: Write, tmp_path: Path) -> None:
    posed = open_posed(write_posed(tmp_path / "posed"), tmp_path / "undistorted")
    assert posed.views.images == tuple(f"{number}.png" for number in range(VIEWS))
    assert posed.points_m.shape == (150, 3)
    assert posed.extent_m == pytest.approx(1.1 * 0.3)
    assert posed.depth_m == 0.0, "the model has points without sightings"
    np.testing.assert_allclose(posed.views.T_world_camera[1, :3, 3], [-0.18, 0, 0], atol=1e-9)
    assert not (tmp_path / "undistorted").exists()


def test_smaller_photos_have_smaller_cameras(write_posed: Write, tmp_path: Path) -> None:
    posed = open_posed(write_posed(tmp_path / "posed"), tmp_path / "undistorted")
    whole, half = (PhotoStore(posed, (2,), 1000, fraction)[2] for fraction in (1, 2))
    assert whole.rgb.shape == (3, *SIZE_PX)
    assert half.rgb.shape == (3, SIZE_PX[0] // 2, SIZE_PX[1] // 2)
    np.testing.assert_allclose(half.K_px[:2] * 2, whole.K_px[:2])
    assert whole.K_px[0, 0] == FOCAL_PX
    assert abs(half.rgb.mean() - whole.rgb.mean()) < 0.01


def test_selected_views_keep_all_points_and_their_own_sightings(write_posed: Write, tmp_path: Path) -> None:
    posed = open_posed(write_posed(tmp_path / "posed"), tmp_path / "undistorted")
    posed = dataclasses.replace(posed, seen=np.array([[0, 5], [3, 6], [1, 7], [3, 8]]))
    some = posed.select([3, 1])
    assert some.views.images == ("3.png", "1.png")
    np.testing.assert_array_equal(some.views.T_world_camera, posed.views.T_world_camera[[3, 1]])
    np.testing.assert_array_equal(some.seen, [[0, 6], [1, 7], [0, 8]])
    assert some.points_m is posed.points_m


def test_photos_that_do_not_fit_into_memory_are_read_again(
    write_posed: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    posed = open_posed(write_posed(tmp_path / "posed"), tmp_path / "undistorted")
    kept = PhotoStore(posed, (0, 1), 1000, 1)
    monkeypatch.setattr(photos, "KEPT_BYTES", 10)
    read = PhotoStore(posed, (0, 1), 1000, 1)
    np.testing.assert_array_equal(kept[1].rgb, read[1].rgb)


def test_broken_and_wrong_images_are_named(write_posed: Write, tmp_path: Path) -> None:
    folder = write_posed(tmp_path / "posed")
    (folder / "images" / "1.png").write_bytes(b"no image")
    write_png(folder / "images" / "2.png", np.zeros((36, 36, 3), np.uint8))
    posed = open_posed(folder, tmp_path / "undistorted")
    with pytest.raises(SceneError, match=r"1.png cannot be read"):
        PhotoStore(posed, (1,), 1000, 1)
    with pytest.raises(SceneError, match="36x36 px, its camera 48x36 px"):
        PhotoStore(posed, (2,), 1000, 1)


def test_lens_distortion_is_taken_out_first(write_posed: Write, tmp_path: Path) -> None:
    folder = write_posed(tmp_path / "posed")
    cameras = folder / "sparse" / "0" / "cameras.txt"
    cameras.write_text("1 SIMPLE_RADIAL 48 36 45 24 18 0.05\n")
    posed = open_posed(folder, tmp_path / "undistorted")
    assert posed.folder == tmp_path / "undistorted" / "images"
    assert len(posed.views) == VIEWS


def test_every_nth_view_is_held_out_where_each_shows_its_own_moment() -> None:
    assert split_views(range(5), 2) == ((1, 3), (0, 2, 4))
    assert split_views(range(3), 0) == ((0, 1, 2), ())


def test_all_views_of_one_moment_are_held_out_together() -> None:
    assert split_views((0, 1, 2, 0, 1, 2), 2) == ((1, 4), (0, 2, 3, 5))
    assert split_views((0, 1, 0, 1), 0) == ((0, 1, 2, 3), ())


def test_views_are_put_together_by_moment() -> None:
    assert views_by_moment(np.array([0, 1, 2, 0, 1, 2]), (1, 2, 3, 4)) == [[1, 4], [2], [3]]


def test_each_photo_shows_a_moment_of_its_own_and_views_of_a_rig_one(write_posed: Write, tmp_path: Path) -> None:
    folder = write_posed(tmp_path / "posed")
    posed = open_posed(folder, tmp_path / "undistorted")
    np.testing.assert_array_equal(posed.moments, np.arange(VIEWS))
    rig_frames(folder / "sparse" / "0")
    np.testing.assert_array_equal(open_posed(folder, tmp_path / "undistorted").moments, [0, 1, 2, 0, 1, 2])
    np.testing.assert_array_equal(open_posed(folder, tmp_path / "undistorted").select([5, 1]).moments, [2, 1])


def test_undistorted_views_of_a_rig_show_its_moments(write_posed: Write, tmp_path: Path) -> None:
    folder = distorted(write_posed(tmp_path / "posed"))
    rig_frames(folder / "sparse" / "0")
    np.testing.assert_array_equal(open_posed(folder, tmp_path / "undistorted").moments, [0, 1, 2, 0, 1, 2])


def test_depth_is_the_median_along_the_axes_of_the_views_that_see_the_points(
    write_posed: Write, tmp_path: Path
) -> None:
    posed = open_posed(write_posed(tmp_path / "posed"), tmp_path / "undistorted")
    seen = np.array([(view, point) for view in range(VIEWS) for point in range(150)])
    sighted = dataclasses.replace(posed, seen=seen)
    assert sighted.depth_m == pytest.approx(float(np.median(posed.points_m[:, 2])))


def write_masks(folder: Path, mask: np.ndarray) -> None:
    (folder / "masks").mkdir(exist_ok=True)
    for number in range(VIEWS):
        cv2.imwrite(str(folder / "masks" / f"{number}.png.png"), mask)


def test_masks_beside_the_images_are_read_at_the_photos_size(write_posed: Write, tmp_path: Path) -> None:
    folder = write_posed(tmp_path / "posed")
    mask = np.full(SIZE_PX, 255, np.uint8)
    mask[:, :7] = 0
    write_masks(folder, mask)
    posed = open_posed(folder, tmp_path / "undistorted")
    whole, small = (PhotoStore(posed, (2,), 1000, fraction)[2].mask for fraction in (1, 2))
    assert whole is not None
    assert small is not None
    np.testing.assert_array_equal(whole, mask > 0)
    assert small.shape == (SIZE_PX[0] // 2, SIZE_PX[1] // 2)
    np.testing.assert_array_equal(small[0, :5], [False, False, False, False, True])


def test_missing_and_wrong_masks_are_named(write_posed: Write, tmp_path: Path) -> None:
    folder = write_posed(tmp_path / "posed")
    write_masks(folder, np.full((36, 36), 255, np.uint8))
    posed = open_posed(folder, tmp_path / "undistorted")
    with pytest.raises(SceneError, match=r"2\.png\.png is 36x36 px, its camera 48x36 px"):
        PhotoStore(posed, (2,), 1000, 1)
    (folder / "masks" / "3.png.png").unlink()
    with pytest.raises(SceneError, match=r"lacks 1 masks of the model, 3\.png\.png"):
        open_posed(folder, tmp_path / "undistorted")


def distorted(folder: Path) -> Path:
    """The model with a lens that bends lines."""
    (folder / "sparse" / "0" / "cameras.txt").write_text("1 SIMPLE_RADIAL 48 36 45 24 18 0.05\n")
    return folder


def test_each_of_two_distorted_models_gives_its_own_poses(write_posed: Write, tmp_path: Path) -> None:
    first, second = (distorted(write_posed(tmp_path / name)) for name in ("first", "second"))
    path = second / "sparse" / "0" / "images.txt"
    path.write_text(path.read_text().replace("1 1 0 0 0 0.3 ", "1 1 0 0 0 0.9 "))
    for folder, x_m in ((first, -0.3), (second, -0.9), (first, -0.3)):
        posed = open_posed(folder, tmp_path / "undistorted")
        np.testing.assert_allclose(posed.views.T_world_camera[0, :3, 3], [x_m, 0, 0], atol=1e-9)


def test_undistorted_images_are_made_once_and_again_when_an_image_changes(write_posed: Write, tmp_path: Path) -> None:
    folder, made = distorted(write_posed(tmp_path / "posed")), tmp_path / "new" / "undistorted" / "images" / "0.png"
    open_posed(folder, made.parent.parent)
    before = made.stat().st_mtime_ns
    open_posed(folder, made.parent.parent)
    assert made.stat().st_mtime_ns == before
    write_png(folder / "images" / "0.png", np.zeros((*SIZE_PX, 3), np.uint8))
    open_posed(folder, made.parent.parent)
    assert cv2.imread(str(made)).max() == 0


def test_missing_mask_of_a_distorted_model_is_named_each_time_and_later_ones_are_used(
    write_posed: Write, tmp_path: Path
) -> None:
    folder = distorted(write_posed(tmp_path / "posed"))
    assert open_posed(folder, tmp_path / "undistorted").masks is None
    write_masks(folder, np.full(SIZE_PX, 255, np.uint8))
    (folder / "masks" / "3.png.png").unlink()
    for _ in range(2):
        with pytest.raises(SceneError, match=r"3\.png\.png is missing"):
            open_posed(folder, tmp_path / "undistorted")
    write_masks(folder, np.full(SIZE_PX, 255, np.uint8))
    posed = open_posed(folder, tmp_path / "undistorted")
    assert posed.masks == tmp_path / "undistorted" / "masks"
    assert PhotoStore(posed, (3,), 1000, 1)[3].mask is not None


def test_missing_image_of_a_distorted_model_is_named(write_posed: Write, tmp_path: Path) -> None:
    folder = distorted(write_posed(tmp_path / "posed"))
    (folder / "images" / "2.png").unlink()
    with pytest.raises(SceneError, match=r"lacks 1 images of the model, 2\.png"):
        open_posed(folder, tmp_path / "undistorted")


@pytest.mark.parametrize("orientation", [3, 6])
@pytest.mark.parametrize("bent", [False, True])
def test_photos_are_read_as_they_lie_in_the_file_and_exif_does_not_turn_them(
    write_posed: Write, tmp_path: Path, orientation: int, bent: bool
) -> None:
    folder = write_posed(tmp_path / "posed")
    pixels = np.zeros((*SIZE_PX, 3), np.uint8)
    pixels[:, 36:] = 255
    data = cv2.imencode(".jpg", pixels)[1].tobytes()
    (folder / "images" / "1.jpg").write_bytes(exif("<", orientation, 26) + data[2:])
    path = folder / "sparse" / "0" / "images.txt"
    path.write_text(path.read_text().replace("1.png", "1.jpg"))
    posed = open_posed(distorted(folder) if bent else folder, tmp_path / "undistorted")
    rgb = PhotoStore(posed, (1,), 1000, 1)[1].rgb
    assert rgb[0, :, :30].max() < 0.2 < 0.8 < rgb[0, 8:-8, -6:].min()


def test_depths_have_the_size_of_their_photo(write_posed: Write, tmp_path: Path) -> None:
    folder = write_posed(tmp_path / "posed")
    assert open_posed(folder, tmp_path / "undistorted").depths is None
    (folder / "depth").mkdir()
    steps = np.where(np.arange(12) < 6, 1500, 0).astype(np.uint16)
    cv2.imwrite(str(folder / "depth" / "1.png.png"), np.tile(steps, (9, 1)))
    posed = open_posed(folder, tmp_path / "undistorted")
    store = PhotoStore(posed, (0, 1), 1000, 1)
    assert store[0].depth_m is None
    depth_m = store[1].depth_m
    assert depth_m is not None
    assert depth_m.shape == SIZE_PX
    np.testing.assert_allclose(depth_m, np.tile(np.where(np.arange(48) < 24, 1.5, 0.0), (36, 1)), rtol=1e-6)
    small = PhotoStore(posed, (1,), 1000, 2)[1].depth_m
    np.testing.assert_allclose(small, depth_m[::2, ::2], rtol=1e-6)
    distorted(folder)
    again = PhotoStore(open_posed(folder, tmp_path / "undistorted"), (0, 1), 1000, 1)
    bent_m = again[1].depth_m
    assert again[0].depth_m is None
    assert bent_m is not None
    np.testing.assert_allclose(np.unique(bent_m), [0.0, 1.5], rtol=1e-6)
    assert photos.bytes_of(posed) == photos.bytes_of(dataclasses.replace(posed, depths=None)) + 2
