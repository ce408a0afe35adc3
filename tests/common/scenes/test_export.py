import dataclasses
import json

import numpy as np
import pytest

from readygo.common.camera.captured import CapturedViews, load_views
from readygo.common.errors import SceneError
from readygo.common.gaussians import load_gaussians
from readygo.common.scenes import export, import_scene, load_scene, save_scene
from readygo.common.scenes.export import export_scene, points_of
from tests.common.scenes.small_room import small_room
from tests.services.reconstructor.synthetic import ring


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    """A scene with four cameras and a sky."""
    K = np.tile([[60.0, 0, 41.0], [0, 62.0, 29.0], [0, 0, 1]], (4, 1, 1))
    names = tuple(f"{k}.jpg" for k in range(4))
    views = CapturedViews(images=names, sizes_px=np.tile([80, 60], (4, 1)), K_px=K, T_world_camera=ring(4))
    sky = small_room().select(np.arange(5))
    out = tmp_path_factory.mktemp("scenes") / "room"
    return save_scene(small_room(), sky, out, license="CC0", views=views)


def same_views(a, b):
    assert a.images == b.images
    for name in ("sizes_px", "K_px", "T_world_camera"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=1e-9)


def test_3dgs_comes_back_by_import(filmed, tmp_path):
    files = export_scene(filmed, "3dgs", tmp_path / "out")
    assert files == ["point_cloud/iteration_0/point_cloud.ply", "cameras.json", "sky.ply"]
    same_views(load_views(tmp_path / "out" / "cameras.json"), filmed.views)
    for name in ("means_m", "quats_wxyz", "scales_m", "opacities", "sh"):
        there = getattr(load_gaussians(tmp_path / "out" / files[0]), name)
        np.testing.assert_allclose(there, getattr(filmed.cloud, name), rtol=1e-4, atol=1e-5)
    again = import_scene(tmp_path / "out", tmp_path / "again")
    same_views(again.views, filmed.views)
    assert (len(again.cloud), len(again.sky)) == (len(filmed.cloud), 5)


def test_colmap_model_comes_back_by_the_reconstructor(filmed, tmp_path):
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    from readygo.services.reconstructor.poses import colmap

    assert export_scene(filmed, "colmap", tmp_path / "out")[0] == "sparse/0/cameras.txt"
    model = colmap.find_model(tmp_path / "out")
    assert model is not None
    same_views(colmap.pinhole_views(model), filmed.views)
    points_m, rgb = points_of(filmed.cloud)
    found = colmap.read_map(model)
    np.testing.assert_allclose(found.points, points_m, atol=1e-9)
    np.testing.assert_array_equal(found.points_rgb, rgb)


def test_transforms_come_back_by_the_reconstructor(filmed, tmp_path):
    from readygo.services.reconstructor.given.transforms import read_transforms

    assert export_scene(filmed, "transforms", tmp_path / "out") == ["transforms.json"]
    given = read_transforms(tmp_path / "out" / "transforms.json")
    np.testing.assert_allclose(given.T_world_camera, filmed.views.T_world_camera, atol=1e-12)
    assert [lens.params[:4] for lens in given.lenses] == [(60.0, 62.0, 41.0, 29.0)] * 4
    assert [path.name for path in given.images] == list(filmed.views.images)


def test_images_are_copied_whole_or_not_at_all(filmed, tmp_path):
    (tmp_path / "images").mkdir()
    for name in filmed.views.images[:3]:
        (tmp_path / "images" / name).write_bytes(b"jpeg")
    with pytest.raises(SceneError, match=r"lacks 1 images of the scene's cameras, 3\.jpg"):
        export_scene(filmed, "colmap", tmp_path / "out", tmp_path / "images")
    assert not (tmp_path / "out").exists()
    (tmp_path / "images" / "3.jpg").write_bytes(b"jpeg")
    export_scene(filmed, "colmap", tmp_path / "out", tmp_path / "images")
    assert sorted(path.name for path in (tmp_path / "out" / "images").iterdir()) == list(filmed.views.images)
    with pytest.raises(SceneError, match="exists already"):
        export_scene(filmed, "colmap", tmp_path / "out")


def test_names_that_lead_elsewhere_are_not_copied(filmed, tmp_path):
    views = dataclasses.replace(filmed.views, images=("../a.jpg", *filmed.views.images[1:]))
    with pytest.raises(SceneError, match="leads out"):
        export._images(views, tmp_path)


def test_scene_without_cameras_is_exported_as_gaussians_alone(tmp_path):
    bare = load_scene(save_scene(small_room(), None, tmp_path / "bare").path)
    for kind in ("colmap", "transforms"):
        with pytest.raises(SceneError, match="has no cameras"):
            export_scene(bare, kind, tmp_path / "out")
    assert export_scene(bare, "3dgs", tmp_path / "out") == ["point_cloud/iteration_0/point_cloud.ply"]
    assert json.dumps(sorted(path.name for path in (tmp_path / "out").iterdir())) == '["point_cloud"]'


def test_many_gaussians_give_fewer_points(filmed, monkeypatch):
    monkeypatch.setattr(export, "POINTS_MAX", 10)
    points_m, rgb = points_of(filmed.cloud)
    assert 5 <= len(points_m) == len(rgb) <= 10
