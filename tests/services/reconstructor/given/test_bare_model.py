from pathlib import Path

import numpy as np
import pytest

from readygo.common.camera.captured import CapturedViews
from readygo.common.camera.written import colmap_texts
from readygo.services.reconstructor.given.bare_model import find_bare_model
from readygo.services.reconstructor.given.find import read_capture
from tests.services.reconstructor.synthetic import ring, synthetic_database

pytest.importorskip("pycolmap", reason="pycolmap is not installed")


def test_model_without_tracks_is_a_capture_with_poses_and_lenses(tmp_path: Path) -> None:
    K = np.tile([[60.0, 0, 41.0], [0, 62.0, 29.0], [0, 0, 1]], (4, 1, 1))
    names = tuple(f"{k}.jpg" for k in range(4))
    views = CapturedViews(images=names, sizes_px=np.tile([80, 60], (4, 1)), K_px=K, T_world_camera=ring(4))
    (tmp_path / "sparse").mkdir()
    for name, text in colmap_texts(views, np.ones((3, 3)), np.ones((3, 3), np.uint8)).items():
        (tmp_path / "sparse" / name).write_text(text)
    found = read_capture(tmp_path)
    assert found is not None
    assert (found.kind, found.metric, found.rough) == ("COLMAP model without tracks", False, False)
    assert [path.name for path in found.images] == list(names)
    np.testing.assert_allclose(found.T_world_camera, views.T_world_camera, atol=1e-12)
    assert {(lens.model, lens.params, lens.size_px) for lens in found.lenses} == {
        ("PINHOLE", (60.0, 62.0, 41.0, 29.0), (80, 60))
    }


def test_models_with_tracks_or_without_images_are_left_alone(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    assert find_bare_model(tmp_path) is None
    (tmp_path / "m").mkdir()
    for name in ("cameras", "images", "points3D"):
        (tmp_path / "m" / f"{name}.txt").touch()
    assert find_bare_model(tmp_path / "m") is None
    assert find_bare_model(tmp_path / "nothing") is None
