from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.frames.panorama import (
    cut_panoramas,
    panorama_rays,
    panorama_width_px,
    view_rotations,
    view_side_px,
)
from readygo.services.reconstructor.frames.video import write_jpeg


def of_rays(rays: np.ndarray) -> np.ndarray:
    """A colour for each ray that changes smoothly with it."""
    return np.rint(128.0 + 90.0 * rays).astype(np.uint8)


def found(width_px: int, height_px: int) -> dict[str, object]:
    return {"frames": 1, "kept": 1, "size_px": [width_px, height_px], "focal_px": 900.0, "notes": []}


def test_middle_of_a_panorama_is_ahead_its_quarter_to_the_right_and_its_top_up() -> None:
    rays = panorama_rays(400)
    assert rays.shape == (200, 400, 3)
    np.testing.assert_allclose(rays[100, 200], (0, 0, 1), atol=0.02)
    np.testing.assert_allclose(rays[100, 300], (1, 0, 0), atol=0.02)
    np.testing.assert_allclose(rays[0, 77], (0, -1, 0), atol=0.02)


def test_views_are_level_rotations_that_cover_the_horizon_but_not_the_ground_below() -> None:
    rotations = np.array(list(view_rotations().values()))
    np.testing.assert_allclose(rotations @ rotations.swapaxes(1, 2), np.tile(np.eye(3), (8, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    np.testing.assert_allclose(rotations[:, 1, 0], 0.0, atol=1e-12)
    np.testing.assert_array_equal(rotations[0], np.eye(3))
    rays = panorama_rays(360).reshape(-1, 3) @ rotations
    seen = ((rays[..., 2] > 0) & (np.abs(rays[..., :2]) <= rays[..., 2:]).all(axis=2)).sum(axis=0).reshape(180, 360)
    assert seen[60:120].min() >= 1, "30 degrees above and below the horizon"
    assert seen[157:].max() == 0, "the photographer, from 67 degrees below the horizon on"


def test_each_pixel_of_a_view_shows_its_ray_also_across_the_border(tmp_path: Path) -> None:
    write_jpeg(tmp_path / "a.jpg", of_rays(panorama_rays(512)))
    cut = cut_panoramas(tmp_path, found(512, 256))
    side = view_side_px(512)
    assert cut["size_px"] == [side, side]
    assert cut["lens"]["view_3/a.jpg"] == ["PINHOLE", side / 2, side / 2, side / 2, side / 2]
    assert (cut["kept"], cut["focal_px"]) == (8, 0.0)
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.jpg")) == sorted(cut["lens"])
    along = (np.arange(side) + 0.5) / (side / 2) - 1.0
    x, y = np.meshgrid(along, along)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    for name, R in cut["rig"].items():
        view = cv2.imread(str(tmp_path / name / "a.jpg"))
        assert view is not None
        off = np.abs(view.astype(int) - of_rays(rays @ np.array(R).T))
        assert off.max() <= 6, name
        assert off.mean() < 1.0, name


def test_edges_stay_where_they_are_in_light(tmp_path: Path) -> None:
    """A white half behind a black one: the sum of the light of a row tells where the edge is."""
    panorama = np.zeros((256, 512, 3), np.uint8)
    panorama[:, 256:] = 255
    cv2.imwrite(str(tmp_path / "a.jpg"), panorama)
    side = cut_panoramas(tmp_path, found(512, 256))["size_px"][0]
    row = cv2.imread(str(tmp_path / "view_0" / "a.jpg"))[side // 2, 20:-20, 0]
    light = (row / 255.0) ** 2.2
    assert light.sum() == pytest.approx(len(row) / 2, abs=0.1)


@pytest.mark.parametrize("size", [[640, 480], [[512, 256], [640, 320]]])
def test_other_shapes_are_refused(tmp_path: Path, size: list[object]) -> None:
    with pytest.raises(SceneError, match="no 360-degree images, whose width is twice the height, all of one size"):
        cut_panoramas(tmp_path, {"size_px": size})


def test_panoramas_are_kept_as_fine_as_their_views() -> None:
    assert view_side_px(panorama_width_px(1600)) == 1600
    assert view_side_px(5760) == 1834
