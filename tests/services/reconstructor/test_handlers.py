from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.config import FramesConfig, MetricConfig, ReconstructorConfig
from readygo.services.reconstructor.handlers import find_poses, make_markers, open_source
from readygo.services.reconstructor.stages import StageProgress


def photos(folder: Path, count: int) -> Path:
    folder.mkdir(exist_ok=True)
    for number in range(count):
        cv2.imwrite(str(folder / f"{number}.jpg"), np.full((60, 80, 3), 90, np.uint8))
    return folder


def test_kinds_of_sources_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").write_bytes(b"x")
    assert open_source(tmp_path / "v.mp4").kind == "video"
    assert open_source(photos(tmp_path / "p", 2)).kind == "photos"
    (tmp_path / "m" / "sparse").mkdir(parents=True)
    for name in ("cameras", "images", "points3D"):
        (tmp_path / "m" / "sparse" / f"{name}.txt").touch()
    assert open_source(tmp_path / "m").kind == "colmap"


def test_paths_that_are_no_source_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="does not exist"):
        open_source(tmp_path / "x.mp4")
    with pytest.raises(SceneError, match="holds no photos"):
        open_source(tmp_path)


def test_work_without_a_scale_does_not_begin(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="Nothing tells the scale"):
        find_poses(photos(tmp_path / "p", 4), tmp_path / "out", ReconstructorConfig(), print)
    assert not (tmp_path / "out").exists()


def test_images_without_markers_are_refused(tmp_path: Path) -> None:
    config = ReconstructorConfig(metric=MetricConfig(marker_size_m=0.2))
    frames = {"names": ["0.jpg", "1.jpg"]}
    with pytest.raises(SceneError, match=r"No image shows a marker of 4X4_50.*--marker-dictionary"):
        make_markers(photos(tmp_path / "p", 2), frames, config, tmp_path)


def test_photos_without_texture_end_with_advice_and_keep_what_is_done(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    config = ReconstructorConfig(metric=MetricConfig(scale=1.0), frames=FramesConfig(side_max_px=320))
    said: list[str] = []

    def hear(progress: StageProgress) -> None:
        said.append(progress.stage)

    for _ in range(2):
        with pytest.raises(SceneError, match=r"0 of 3 images found a pose.*Film again"):
            find_poses(photos(tmp_path / "p", 3) if not said else tmp_path / "p", tmp_path / "out", config, hear)
    assert said == ["frames", "features", "matches", "map", "map"]
    assert not (tmp_path / "out" / "map").exists()
