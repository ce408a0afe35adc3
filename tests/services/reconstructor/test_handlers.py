from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.config import FramesConfig, MetricConfig, PosesConfig, ReconstructorConfig
from readygo.services.reconstructor.handlers import Source, find_poses, make_map, make_markers, open_source
from readygo.services.reconstructor.poses import colmap
from readygo.services.reconstructor.stages import StageProgress
from tests.services.reconstructor.synthetic import synthetic_database


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


@pytest.mark.parametrize(
    ("length", "words", "stages"),
    [
        ("a.jpg:1,2 a.jpg:3 = 1", "is no pick", []),
        ("0.jpg:1,2 0.jpg:3,4 9.jpg:1,2 9.jpg:3,4 = 1", r"9\.jpg, which is no image here", ["frames"]),
    ],
)
def test_lengths_that_cannot_be_are_refused_before_the_poses(
    tmp_path: Path, length: str, words: str, stages: list[str]
) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    config, said = ReconstructorConfig(metric=MetricConfig(lengths=(length,))), list[str]()
    with pytest.raises(ConfigError, match=words):
        find_poses(photos(tmp_path / "p", 3), tmp_path / "out", config, lambda progress: said.append(progress.stage))
    assert said == stages


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


def map_of_few_matches(folder: Path) -> dict[str, Any]:
    """What comes of five images all of which are wanted, the last of which has 20 matches with each other one."""
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    (folder / "matches").mkdir(parents=True)
    synthetic_database(folder / "matches", matches_of_last=20)
    (folder / "matches" / "images").rename(folder / "frames")
    (folder / "map").mkdir()
    source = Source(path=folder, kind="photos", identity=())
    config = ReconstructorConfig(poses=PosesConfig(threads=1, registered_min=1.0))
    return dict(make_map(folder, source, {"names": ["1", "2", "3", "4", "5"]}, [], config, folder / "map"))


def test_images_with_few_matches_have_a_pose_where_too_few_have_one(tmp_path: Path) -> None:
    made = map_of_few_matches(tmp_path)
    assert made["verdict"]["registered"] == 5
    assert len(colmap.read_map(tmp_path / "map" / "0").names) == 4
    assert len(colmap.read_map(tmp_path / "map" / made["model"]).names) == 5


def test_maps_of_few_matches_must_come_out_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build = colmap.build_maps

    def nothing_again(*args: Any, few_matches: bool, **kwargs: Any) -> list[Path]:
        return [] if args[3].seed else build(*args, few_matches=few_matches, **kwargs)

    monkeypatch.setattr(colmap, "build_maps", nothing_again)
    with pytest.raises(SceneError, match=r"made twice, the map has 5 images, then 0"):
        map_of_few_matches(tmp_path)
