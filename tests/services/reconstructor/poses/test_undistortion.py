from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.frames.depths import read_steps
from readygo.services.reconstructor.poses.colmap import read_map
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.poses.undistortion import (
    write_undistorted,
    write_undistorted_depths,
    write_undistorted_masks,
)
from tests.services.reconstructor.synthetic import some_similarity, synthetic_database

pytest.importorskip("pycolmap", reason="pycolmap is not installed")


def test_model_is_moved_and_its_images_are_undistorted(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    model = tmp_path / "sparse"
    images = read_map(model)
    (tmp_path / "out").mkdir()
    write_undistorted(model, tmp_path / "images", tmp_path / "out", some_similarity(), PosesConfig(threads=1))
    again = read_map(tmp_path / "out" / "sparse" / "0")
    np.testing.assert_allclose(again.T_world_camera, images.transform(some_similarity()).T_world_camera, atol=1e-6)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"images", "sparse"}


def test_masks_are_undistorted_as_their_images_are(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    names = read_map(tmp_path / "sparse").names
    mask = np.full((120, 160), 255, np.uint8)
    cv2.circle(mask, (130, 30), 14, 0, -1)
    for name in names:
        path = tmp_path / "masks" / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), mask)
        cv2.imwrite(str(tmp_path / "images" / f"{name}.png"), cv2.merge([mask] * 3))
        (tmp_path / "images" / f"{name}.png").rename(tmp_path / "images" / name)
    (tmp_path / "out").mkdir()
    write_undistorted(
        tmp_path / "sparse", tmp_path / "images", tmp_path / "out", some_similarity(), PosesConfig(threads=1)
    )
    write_undistorted_masks(tmp_path / "sparse", tmp_path / "masks", tmp_path / "out")
    for name in names:
        flat = cv2.imread(str(tmp_path / "out" / "masks" / f"{name}.png"), cv2.IMREAD_UNCHANGED)
        shown = cv2.imread(str(tmp_path / "out" / "images" / name), cv2.IMREAD_GRAYSCALE)
        assert flat.shape == shown.shape
        assert set(np.unique(flat)) <= {0, 255}
        assert ((flat > 0) == (shown > 127)).mean() > 0.99
    cv2.imwrite(str(tmp_path / "masks" / f"{names[0]}.png"), mask[:60])
    with pytest.raises(SceneError, match="is 160x60 px, its image 160x120 px"):
        write_undistorted_masks(tmp_path / "sparse", tmp_path / "masks", tmp_path / "out")


def test_depths_are_undistorted_as_their_images_are_and_become_longer(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    names = read_map(tmp_path / "sparse").names
    near = np.full((120, 160, 3), 255, np.uint8)
    cv2.circle(near, (130, 30), 14, (0, 0, 0), -1)
    for name in names:
        cv2.imwrite(str(tmp_path / "images" / f"{name}.png"), near)
        (tmp_path / "images" / f"{name}.png").rename(tmp_path / "images" / name)
    steps = np.where(near[1::2, 1::2, 0] > 0, 2000, 1000).astype(np.uint16)
    (tmp_path / "depth").mkdir()
    cv2.imwrite(str(tmp_path / "depth" / f"{names[1]}.png"), steps)
    (tmp_path / "out").mkdir()
    model, similarity = tmp_path / "sparse", some_similarity()
    write_undistorted(model, tmp_path / "images", tmp_path / "out", similarity, PosesConfig(threads=1))
    write_undistorted_depths(model, tmp_path / "depth", tmp_path / "out", 1.5)
    assert [path.name for path in (tmp_path / "out" / "depth").iterdir()] == [f"{names[1]}.png"]
    flat = read_steps(tmp_path / "out" / "depth" / f"{names[1]}.png")
    shown = cv2.imread(str(tmp_path / "out" / "images" / names[1]), cv2.IMREAD_GRAYSCALE)
    assert flat is not None
    assert max(flat.shape) == 80
    assert set(np.unique(flat)) <= {0, 1500, 3000}
    whole = cv2.resize(flat, shown.shape[::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    assert ((whole == 3000) == (shown > 127))[whole > 0].mean() > 0.99
