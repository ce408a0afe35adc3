import dataclasses
import json

import cv2
import numpy as np
import pytest

from readygo.apps.commands.scene_edit import (
    SceneAlignOptions,
    SceneCleanOptions,
    SceneCropOptions,
    SceneScaleOptions,
    scene_align,
    scene_clean,
    scene_crop,
    scene_scale,
)
from readygo.apps.commands.scene_report import SceneReportOptions, scene_report
from readygo.common.errors import SceneError
from readygo.common.gaussians import concatenate, load_gaussians, save_ply
from readygo.common.maps import MapConfig
from readygo.common.scenes import SceneSource, import_scene, load_scene, save_scene
from tests.common.maps.room import box, room


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    far = box((9, 9, 3), (9.1, 9.1, 3.1))
    cloud = concatenate([room(), box((1, 1, 0), (2, 1.5, 0.8)), far])
    out = tmp_path_factory.mktemp("scenes") / "room"
    config = MapConfig(human_height_m=1.7)
    return save_scene(cloud, None, out, license="CC0", source=SceneSource(file="a.ply"), map_config=config)


def test_cropped_bundle_says_what_was_done_and_keeps_what_it_was_made_with(bundle, tmp_path, capsys):
    scene_crop(SceneCropOptions(scene=str(bundle.path), out=tmp_path / "part", box=(0.0, 0.0, 4.0, 5.0)))
    part = load_scene(tmp_path / "part")
    assert part.cloud.means_m[:, 0].max() <= 4.0
    assert part.license == "CC0"
    assert part.metadata["source"]["file"] == "a.ply"
    assert part.metadata["source"]["edits"] == ["cropped to x 0..4 m, y 0..5 m"]
    assert part.maps.config == bundle.maps.config
    assert cv2.imread(str(tmp_path / "part" / "inspect" / "change.png")).shape[1] > 400
    assert "of" in capsys.readouterr().out
    with pytest.raises(SceneError, match="exists already"):
        scene_crop(SceneCropOptions(scene=str(bundle.path), out=tmp_path / "part", z=(0.0, 1.0)))
    with pytest.raises(SceneError, match="--box"):
        scene_crop(SceneCropOptions(scene=str(bundle.path), out=tmp_path / "none"))


def test_files_are_cleaned_and_scaled_to_files(bundle, tmp_path, capsys):
    save_ply(bundle.cloud, tmp_path / "a.ply")
    scene_clean(SceneCleanOptions(scene=str(tmp_path / "a.ply"), out=tmp_path / "clean.ply"))
    assert "floaters: " in capsys.readouterr().out
    clean = load_gaussians(tmp_path / "clean.ply")
    assert clean.means_m.max() < 7.0
    scene_scale(SceneScaleOptions(scene=str(tmp_path / "clean.ply"), out=tmp_path / "double.ply", factor=2.0))
    double = load_gaussians(tmp_path / "double.ply")
    np.testing.assert_allclose(double.means_m, 2 * clean.means_m, rtol=1e-6)
    assert (tmp_path / "double.png").exists()
    with pytest.raises(SceneError, match="--factor or --room-height"):
        scene_scale(SceneScaleOptions(scene=str(tmp_path / "clean.ply"), out=tmp_path / "none.ply"))


def test_aligned_scene_stands_on_height_0(bundle, tmp_path):
    raised = dataclasses.replace(bundle.cloud, means_m=bundle.cloud.means_m + np.array([0, 0, 3], np.float32))
    save_ply(raised, tmp_path / "raised.ply")
    scene_align(SceneAlignOptions(scene=str(tmp_path / "raised.ply"), out=tmp_path / "level.ply"))
    assert np.quantile(load_gaussians(tmp_path / "level.ply").means_m[:, 2], 0.02) == pytest.approx(0.0, abs=0.05)


REPORT = {
    "kind": "video",
    "verdict": {"registered": 38, "images": 41},
    "scale": {"metres_per_unit": 0.5, "source": "marker 3", "low": 0.49, "high": 0.51, "interval_percent": 2.0,
              "drift_percent": 1.0},
    "up": "marker 3 on the floor",
    "markers": [{"marker": 3, "views": 9, "residual_px": 0.3, "side_m": 0.2, "sides_m": [0.2] * 4,
                 "centre_m": [1.0, 2.0, 0.5]}],
    "notes": ["cameras are low"],
    "training": {"psnr_db": 25.0, "psnr_fitted_db": 26.0, "ssim": 0.8, "held_out": [{"image": "0.jpg"}],
                 "settings": {"steps": 9}},
}  # fmt: skip


@pytest.fixture(scope="module")
def reconstructed(tmp_path_factory):
    cloud = concatenate([room(), box((1, 1, 0), (2, 1.5, 0.8))])
    return str(save_scene(cloud, None, tmp_path_factory.mktemp("scenes") / "room", reconstruction=REPORT).path)


def test_reports_of_cropped_and_cleaned_scenes_have_all_but_the_scores_of_images(reconstructed, tmp_path):
    scene_crop(SceneCropOptions(scene=reconstructed, out=tmp_path / "part", box=(0.0, 0.0, 4.0, 5.0)))
    scene_clean(SceneCleanOptions(scene=reconstructed, out=tmp_path / "clean"))
    for name in ("part", "clean"):
        report = load_scene(tmp_path / name).reconstruction
        assert {key: report[key] for key in REPORT if key != "training"} == {
            key: REPORT[key] for key in REPORT if key != "training"
        }
        assert report["training"] == {
            "psnr_db": None, "psnr_fitted_db": None, "ssim": None, "held_out": [], "settings": {"steps": 9}
        }  # fmt: skip


def test_report_of_a_scaled_scene_names_the_factor_and_no_interval(reconstructed, tmp_path):
    scene_scale(SceneScaleOptions(scene=reconstructed, out=tmp_path / "once", factor=1.2))
    scene_scale(SceneScaleOptions(scene=str(tmp_path / "once"), out=tmp_path / "twice", factor=0.9))
    report = load_scene(tmp_path / "twice").reconstruction
    assert report["scale"] == {
        "metres_per_unit": pytest.approx(0.54), "source": "marker 3, then scaled by 1.2, then scaled by 0.9",
        "low": None, "high": None, "interval_percent": None, "drift_percent": None,
    }  # fmt: skip
    (marker,) = report["markers"]
    assert (marker["side_m"], marker["sides_m"], marker["centre_m"]) == (0.216, [0.216] * 4, [1.08, 2.16, 0.54])
    assert report["notes"] == ["before it was scaled by 0.9: before it was scaled by 1.2: cameras are low"]
    assert (report["training"], report["verdict"], report["up"]) == (
        REPORT["training"], REPORT["verdict"], REPORT["up"]
    )  # fmt: skip


def test_scaled_scene_that_was_imported_says_its_new_scale(bundle, tmp_path, capsys):
    save_ply(bundle.cloud, tmp_path / "room.ply")
    import_scene(tmp_path / "room.ply", tmp_path / "imported", scale=0.9, translate_m=(1.0, 2.0, 0.5))
    scene_scale(SceneScaleOptions(scene=str(tmp_path / "imported"), out=tmp_path / "once", factor=1.2))
    scene_scale(SceneScaleOptions(scene=str(tmp_path / "once"), out=tmp_path / "twice", factor=0.95))
    source = load_scene(tmp_path / "twice").metadata["source"]
    assert source["scale"] == pytest.approx(0.9 * 1.2 * 0.95)
    assert source["scale_origin"] == "given on import, then scaled by 1.2, then scaled by 0.95"
    # The file's Gaussians come to the scene's places by what its source says.
    moved = source["scale"] * load_gaussians(tmp_path / "room.ply").means_m + np.array(source["translate_m"])
    np.testing.assert_allclose(np.sort(load_scene(tmp_path / "twice").cloud.means_m, axis=0), np.sort(moved, axis=0),
                               atol=1e-4)  # fmt: skip
    capsys.readouterr()
    scene_report(SceneReportOptions(scene=str(tmp_path / "twice"), json=True))
    assert json.loads(capsys.readouterr().out)["scale"] == {
        "metres_per_unit": pytest.approx(1.026), "source": source["scale_origin"], "interval_percent": None,
    }  # fmt: skip


def test_report_of_an_aligned_scene_says_what_was_turned(reconstructed, tmp_path):
    scene_align(SceneAlignOptions(scene=reconstructed, out=tmp_path / "level", up="0,0,1"))
    level = load_scene(tmp_path / "level")
    (words,), report = level.metadata["source"]["edits"], level.reconstruction
    assert report["up"] == words
    assert (report["scale"], report["training"]) == (REPORT["scale"], REPORT["training"])
    moved_m = float(words.split()[-2])
    np.testing.assert_allclose(report["markers"][0]["centre_m"], [1.0, 2.0, 0.5 + moved_m], atol=2e-3)
    assert report["notes"] == [f"before it was {words}: cameras are low"]


def test_scenes_that_were_imported_have_no_report_of_a_reconstruction(bundle, tmp_path):
    scene_scale(SceneScaleOptions(scene=str(bundle.path), out=tmp_path / "large", factor=1.1))
    assert load_scene(tmp_path / "large").reconstruction is None
