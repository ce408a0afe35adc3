from pathlib import Path

import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.job import open_source
from tests.services.reconstructor.given import test_find
from tests.services.reconstructor.synthetic import photos


def test_kinds_of_sources_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").write_bytes(b"x")
    assert open_source(tmp_path / "v.mp4").kind == "video"
    assert open_source(photos(tmp_path / "p", 2)).kind == "photos"
    assert open_source(test_find.transforms(tmp_path / "t")).kind == "capture"
    assert open_source(tmp_path / "t" / "transforms.json").kind == "capture"
    names = {name for name, _, _ in open_source(tmp_path / "t").identity}
    assert names == {"transforms.json", "0.png", "1.png", "2.png", "3.png"}
    (tmp_path / "m" / "sparse").mkdir(parents=True)
    for name in ("cameras", "images", "points3D"):
        (tmp_path / "m" / "sparse" / f"{name}.txt").touch()
    assert open_source(tmp_path / "m").kind == "colmap"


def test_paths_that_are_no_source_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="does not exist"):
        open_source(tmp_path / "x.mp4")
    with pytest.raises(SceneError, match="holds no photos"):
        open_source(tmp_path)
