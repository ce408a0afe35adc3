from pathlib import Path
from typing import Any

import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.job import Source
from readygo.services.reconstructor.mapping import make_map
from readygo.services.reconstructor.poses import colmap
from readygo.services.reconstructor.poses.config import PosesConfig
from tests.services.reconstructor.synthetic import synthetic_database


def map_of_few_matches(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What comes of five images all of which are wanted, the last of which has 20 matches with each other one."""
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    (folder / "matches").mkdir(parents=True)
    synthetic_database(folder / "matches", matches_of_last=20)
    (folder / "matches" / "images").rename(folder / "frames")
    (folder / "map").mkdir()
    source = Source(path=folder, kind="photos", identity=())
    monkeypatch.setattr("readygo.services.reconstructor.mapping.REGISTERED_MIN", 1.0)
    config = ReconstructorConfig(poses=PosesConfig(threads=1))
    return dict(make_map(folder, source, {"names": ["1", "2", "3", "4", "5"]}, [], config, folder / "map"))


def test_images_with_few_matches_have_a_pose_where_too_few_have_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = map_of_few_matches(tmp_path, monkeypatch)
    assert made["verdict"]["registered"] == 5
    assert len(colmap.read_map(tmp_path / "map" / "0").names) == 4
    assert len(colmap.read_map(tmp_path / "map" / made["model"]).names) == 5


def test_maps_of_few_matches_must_come_out_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build = colmap.build_maps

    def nothing_again(*args: Any, few_matches: bool, **kwargs: Any) -> list[Path]:
        return [] if args[3].seed else build(*args, few_matches=few_matches, **kwargs)

    monkeypatch.setattr(colmap, "build_maps", nothing_again)
    with pytest.raises(SceneError, match=r"made twice, the map has 5 images, then 0"):
        map_of_few_matches(tmp_path, monkeypatch)
