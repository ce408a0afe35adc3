from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from readygo.services.reconstructor.poses.colmap import (
    build_maps,
    extract_features,
    find_model,
    given_model,
    image_names,
    model_files,
    pinhole_views,
    read_map,
)
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.poses.covariance import pose_errors
from readygo.services.reconstructor.poses.intrinsics import Intrinsics, lens
from tests.services.reconstructor.synthetic import synthetic_database

pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")


def test_map_is_read(tmp_path: Path) -> None:
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


def test_map_is_found_from_matches(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    models = build_maps(tmp_path / "database.db", tmp_path / "images", tmp_path, PosesConfig(threads=1), count=5)
    assert len(read_map(models[0]).names) == 5


def test_given_lens_stays_as_it_is_and_a_prior_is_refined(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    given = lens(160.0, 160.0, 83.0, 58.0, [0.01])
    with pycolmap.Database.open(tmp_path / "database.db") as db:
        for camera in db.read_all_cameras():
            camera.model, camera.params = getattr(pycolmap.CameraModelId, given.model), list(given.params)
            camera.has_prior_focal_length = True
            db.update_camera(camera)
    params = {}
    for name, words in {
        "fixed": {}, "prior": {"intrinsics_are": "prior"}, "free": {"intrinsics": "", "refine_principal_point": True},
    }.items():  # fmt: skip
        config = PosesConfig(**{"threads": 1, "intrinsics": "given", **words})  # type: ignore[arg-type]
        (tmp_path / name).mkdir()
        model = build_maps(tmp_path / "database.db", tmp_path / "images", tmp_path / name, config, count=5)[0]
        params[name] = next(iter(pycolmap.Reconstruction(model).cameras.values())).params
    np.testing.assert_array_equal(params["fixed"], given.params)
    assert abs(params["prior"][0] - 150.0) < 8.0
    np.testing.assert_array_equal(params["prior"][2:4], [83.0, 58.0])
    assert not (params["free"][2:4] == [83.0, 58.0]).any()


def test_features_are_of_a_camera_with_the_given_lens(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8))
    given = lens(70.0, 71.0, 39.0, 31.0, [0.1, 0.01, 0.001, 0.002, 0.003])
    extract_features(
        tmp_path / "d.db", tmp_path, ["a.png"], PosesConfig(threads=1), focal_px=9.0, size_px=[80, 60], lens=given
    )
    with pycolmap.Database.open(tmp_path / "d.db") as db:
        (camera,) = db.read_all_cameras()
    assert (camera.model.name, camera.has_prior_focal_length) == ("FULL_OPENCV", True)
    np.testing.assert_array_equal(camera.params, given.params)


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


def test_ignored_pixels_have_no_features(tmp_path: Path) -> None:
    noise = cv2.GaussianBlur(np.random.default_rng(0).normal(size=(240, 320)), (0, 0), 2.5)
    cv2.imwrite(str(tmp_path / "a.png"), (128 + 60 * noise / noise.std()).clip(0, 255).astype(np.uint8))
    mask = np.full((240, 320), 255, np.uint8)
    mask[:, :160] = 0
    (tmp_path / "masks").mkdir()
    cv2.imwrite(str(tmp_path / "masks" / "a.png.png"), mask)
    database = tmp_path / "features.db"
    wanted = {"focal_px": 0.0, "size_px": [320, 240], "masks": tmp_path / "masks"}
    extract_features(database, tmp_path, ["a.png"], PosesConfig(threads=1), **wanted)
    with pycolmap.Database.open(database) as db:
        points = db.read_keypoints(db.read_all_images()[0].image_id)
    assert len(points) > 50
    assert points[:, 0].min() > 158


def test_views_of_one_place_are_a_rig_with_known_rotations_and_one_lens(tmp_path: Path) -> None:
    turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    rig = {"ahead": np.eye(3), "right": turned}
    names = [f"{folder}/{name}.png" for folder in rig for name in ("a", "b")]
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        noise = np.random.default_rng(len(name)).integers(0, 255, (40, 40, 3), dtype=np.uint8)
        cv2.imwrite(str(tmp_path / name), noise)
    given = Intrinsics(model="PINHOLE", params=(20.0, 20.0, 20.0, 20.0))
    wanted = {"focal_px": 0.0, "size_px": [40, 40], "lens": given, "rig": rig}
    extract_features(tmp_path / "d.db", tmp_path, names, PosesConfig(threads=1), **wanted)
    with pycolmap.Database.open(tmp_path / "d.db") as db:
        cameras, images, (made,) = db.read_all_cameras(), db.read_all_images(), db.read_all_rigs()
    assert [list(camera.params) for camera in cameras] == [[20.0] * 4] * 2
    frame_of = {image.name: image.frame_id for image in images}
    assert frame_of["ahead/a.png"] == frame_of["right/a.png"] != frame_of["ahead/b.png"] == frame_of["right/b.png"]
    camera_of = {image.name: image.camera_id for image in images}
    sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera_of["right/a.png"])
    np.testing.assert_allclose(made.sensor_from_rig(sensor).rotation.matrix(), turned.T, atol=1e-12)
    np.testing.assert_array_equal(made.sensor_from_rig(sensor).translation, 0.0)


def test_images_of_a_model_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    rec = pycolmap.Reconstruction(tmp_path / "sparse")
    wanted = ["a/2.png", "a/10.png", "a/100.png", "b/1.png", "b/9.png"]
    for number, name in zip(sorted(rec.reg_image_ids()), (wanted[k] for k in (2, 4, 1, 0, 3)), strict=True):
        rec.images[number].name = name
    rec.write(tmp_path / "sparse")
    names = tuple(wanted)
    assert read_map(tmp_path / "sparse").names == pinhole_views(tmp_path / "sparse").images == names
    assert tuple(image_names(tmp_path / "sparse")) == names
    errors = pose_errors(tmp_path / "sparse", names, PosesConfig())
    assert errors is not None
    assert errors.names == names


def test_files_of_a_model_are_told_from_others(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    (tmp_path / "sparse" / "stage.json").touch()
    (tmp_path / "sparse" / "images").mkdir()
    names = {path.stem for path in model_files(tmp_path / "sparse")}
    assert {"cameras", "images", "points3D"} <= names <= {"cameras", "images", "points3D", "rigs", "frames"}


@pytest.mark.parametrize(
    ("count", "adjust", "made"), [(2, True, False), (3, True, True), (2, False, True), (1, False, False)]
)
def test_poses_are_adjusted_of_three_images_on(tmp_path: Path, count: int, adjust: bool, made: bool) -> None:
    synthetic_database(tmp_path)
    truth = read_map(tmp_path / "sparse")
    poses = dict(list(zip(truth.names, truth.T_world_camera, strict=True))[:count])
    config = PosesConfig(threads=1)
    model = given_model(tmp_path / "database.db", tmp_path / "images", tmp_path / "m", poses, config, adjust=adjust)
    assert (model is not None) == made


def test_global_mapper_keeps_the_rig_in_all_of_its_stages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def global_mapping(*arguments: Any) -> dict[int, Any]:
        asked.append(arguments[-1].mapper)
        return {}

    monkeypatch.setattr(pycolmap, "global_mapping", global_mapping)
    assert build_maps(tmp_path / "d.db", tmp_path, tmp_path, PosesConfig(mapper="global"), count=240) == []
    (mapper,) = asked
    stages = (mapper.get_rotation_averaging(), mapper.get_global_positioning(), mapper.get_bundle_adjustment())
    assert [stage.refine_sensor_from_rig for stage in stages] == [False] * 3
