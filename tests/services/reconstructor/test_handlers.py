from pathlib import Path

import pytest

from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.handlers import find_poses, make_markers
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.stages import StageProgress
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
