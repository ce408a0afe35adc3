from pathlib import Path

import pytest

from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.handlers import find_poses, known_lens, make_markers
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.stages import StageProgress
from tests.services.reconstructor.given import test_find, test_polycam
from tests.services.reconstructor.synthetic import photos


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
    with pytest.raises(SceneError, match=r"No image shows a marker of 4X4_50.*--metric.marker-dictionary"):
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


def test_given_lens_is_fitted_to_the_images_and_needs_one_size(tmp_path: Path) -> None:
    config = ReconstructorConfig(poses=PosesConfig(intrinsics="1000 1000 500 400"))
    assert known_lens({}, ReconstructorConfig()) is None
    found = known_lens({"source_px": [1000, 800], "size_px": [500, 400]}, config)
    assert found is not None
    assert found.params[:4] == (500.0, 500.0, 250.0, 200.0)
    with pytest.raises(ConfigError, match="images of one size"):
        known_lens({"source_px": None, "size_px": [[500, 400], [400, 500]]}, config)


def test_lens_of_other_images_is_refused_before_the_features(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    poses, said = PosesConfig(intrinsics="1000 1000 960 540"), list[str]()
    config = ReconstructorConfig(metric=MetricConfig(scale=1.0), poses=poses)
    with pytest.raises(ConfigError, match="not near the middle of images of 80x60 px"):
        find_poses(photos(tmp_path / "p", 3), tmp_path / "out", config, lambda progress: said.append(progress.stage))
    assert said == ["frames"]
    config = ReconstructorConfig(metric=MetricConfig(scale=1.0), poses=PosesConfig(intrinsics="1 2 3"))
    with pytest.raises(ConfigError, match="3 numbers"):
        find_poses(tmp_path / "p", tmp_path / "other", config, print)
    assert not (tmp_path / "other").exists()


def test_captures_with_poses_need_a_scale_unless_their_device_measured_it(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    said: list[str] = []

    def hear(progress: StageProgress) -> None:
        said.append(progress.stage)

    with pytest.raises(ConfigError, match="Nothing tells the scale"):
        find_poses(test_find.transforms(tmp_path / "t"), tmp_path / "out", ReconstructorConfig(), hear)
    config = ReconstructorConfig(metric=MetricConfig(scale=1.0), poses=PosesConfig(intrinsics="9 9 4 3"))
    with pytest.raises(ConfigError, match="comes with its lenses; leave --intrinsics out"):
        find_poses(tmp_path / "t", tmp_path / "out", config, hear)
    assert said == []
    with pytest.raises(SceneError, match="Film again"):
        find_poses(test_polycam.export(tmp_path / "p"), tmp_path / "out", ReconstructorConfig(), hear)
    assert said == ["frames", "features", "matches", "map"], "grey images share nothing"
