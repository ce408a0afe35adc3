from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.services.reconstructor.poses.colmap import (
    build_maps,
    extract_features,
    find_model,
    read_map,
    write_undistorted,
)
from readygo.services.reconstructor.poses.config import PosesConfig
from tests.services.reconstructor.synthetic import some_similarity, synthetic_database

pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")


def test_map_is_read_moved_and_undistorted(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    model = find_model(tmp_path)
    assert model == tmp_path / "sparse"
    images = read_map(model)
    assert len(images.names) == 5
    point, view = images.points[images.seen[0, 1]], int(images.seen[0, 0])
    T = images.T_world_camera[view]
    seen = (point - T[:3, 3]) @ T[:3, :3]
    rec = pycolmap.Reconstruction(model)
    camera = rec.find_image_with_name(images.names[view]).camera
    np.testing.assert_allclose(images.rays(view, camera.img_from_cam(seen[None])), [seen[:2] / seen[2]], atol=1e-6)
    (tmp_path / "out").mkdir()
    write_undistorted(model, tmp_path / "images", tmp_path / "out", some_similarity(), PosesConfig(threads=1))
    again = read_map(tmp_path / "out" / "sparse" / "0")
    np.testing.assert_allclose(again.T_world_camera, images.transform(some_similarity()).T_world_camera, atol=1e-6)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"images", "sparse"}


def test_map_is_found_from_matches(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    models = build_maps(tmp_path / "database.db", tmp_path / "images", tmp_path, PosesConfig(threads=1), count=5)
    assert len(read_map(models[0]).names) == 5


@pytest.mark.parametrize(
    ("contrast", "features_min", "fainter"), [(4.0, 100, True), (4.0, 0, False), (60.0, 100, False)]
)
def test_fainter_features_are_taken_where_there_are_few(
    tmp_path: Path, contrast: float, features_min: int, fainter: bool
) -> None:
    noise = cv2.GaussianBlur(np.random.default_rng(0).normal(size=(240, 320)), (0, 0), 2.5)
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / name), (128 + contrast * noise / noise.std()).clip(0, 255).astype(np.uint8))
    counts = [_feature_count(tmp_path, config) for config in (0, features_min)]
    assert (counts[1] > 2 * counts[0] + 50) == fainter
    assert fainter or counts[0] == counts[1]


def _feature_count(folder: Path, features_min: int) -> int:
    config = PosesConfig(threads=1)
    database = folder / "features.db"
    extract_features(
        database, folder, ["a.png", "b.png"], config, focal_px=0.0, size_px=[320, 240], features_min=features_min
    )
    with pycolmap.Database.open(database) as db:
        return int(db.num_keypoints_for_image(db.read_all_images()[0].image_id))
