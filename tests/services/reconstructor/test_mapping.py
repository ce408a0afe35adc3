from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.job import Source
from readygo.services.reconstructor.mapping import REPEATS, make_map
from readygo.services.reconstructor.poses import colmap
from readygo.services.reconstructor.poses.config import PosesConfig
from tests.services.reconstructor.synthetic import synthetic_database


def map_of_few_matches(
    folder: Path, monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...] = ("1", "2", "3", "4", "5")
) -> dict[str, Any]:
    """What comes of five images all of which are wanted, the last of which has 20 matches with each other one."""
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    (folder / "matches").mkdir(parents=True)
    synthetic_database(folder / "matches", matches_of_last=20)
    (folder / "matches" / "images").rename(folder / "frames")
    (folder / "map").mkdir()
    source = Source(path=folder, kind="photos", identity=())
    monkeypatch.setattr("readygo.services.reconstructor.mapping.REGISTERED_MIN", 1.0)
    config = ReconstructorConfig(poses=PosesConfig(threads=1))
    return dict(make_map(folder, source, {"names": list(names)}, [], config, folder / "map"))


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


def test_doubtful_map_is_made_again_by_the_mapper_of_all_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build, counts = colmap.build_maps, []

    def counted(*args: Any, count: int, **kwargs: Any) -> list[Path]:
        counts.append(count)
        return build(*args, count=count, **kwargs)

    monkeypatch.setattr(colmap, "build_maps", counted)
    made = map_of_few_matches(tmp_path, monkeypatch, ("1", "2", "3", "4", "5", "without a pose"))
    assert made["verdict"]["registered"] == 5
    assert counts == [6] * (2 + REPEATS)


def given_map(folder: Path, *, off_m: float, given: str) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """True poses, those of the map, and what is said of it, of five images that came with poses."""
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    (folder / "matches").mkdir(parents=True)
    synthetic_database(folder / "matches")
    (folder / "matches" / "images").rename(folder / "frames")
    (folder / "map").mkdir()
    truth = colmap.read_map(folder / "matches" / "sparse")
    rough = truth.T_world_camera.copy()
    rough[:, :3, 3] += np.random.default_rng(1).normal(0.0, off_m, (5, 3))
    pose = dict(zip(truth.names, rough.tolist(), strict=True))
    frames = {"names": list(truth.names), "pose": pose, "rough": True}
    source = Source(path=folder, kind="capture", identity=())
    config = ReconstructorConfig(poses=PosesConfig(threads=1, given=given))  # type: ignore[arg-type]
    made = dict(make_map(folder, source, frames, [], config, folder / "map"))
    found = colmap.read_map(folder / "map" / made["model"])
    return truth.T_world_camera, found.T_world_camera, made


def test_poses_that_came_with_the_images_stay_and_matches_give_points(tmp_path: Path) -> None:
    truth, found, made = given_map(tmp_path, off_m=0.0, given="keep")
    np.testing.assert_allclose(found, truth, atol=1e-9)
    assert made["verdict"]["registered"] == made["verdict"]["images"] == 5
    assert made["verdict"]["points"] > 60
    assert made["verdict"]["reprojection_px"] < 0.1


def test_rough_poses_are_adjusted_in_the_frame_and_scale_that_they_came_in(tmp_path: Path) -> None:
    truth, found, _ = given_map(tmp_path, off_m=0.02, given="auto")
    kept_off = np.random.default_rng(1).normal(0.0, 0.02, (5, 3))
    size = np.linalg.norm(truth[:, :3, 3] - truth[:, :3, 3].mean(axis=0), axis=1).mean()
    assert (
        np.linalg.norm(found[:, :3, 3] - truth[:, :3, 3], axis=1).mean() < 1.5 * np.linalg.norm(kept_off, axis=1).mean()
    )
    shape = [np.linalg.norm(T[:, None, :3, 3] - T[None, :, :3, 3], axis=2) for T in (truth, found)]
    ratio = (shape[1] / np.where(shape[0] > 0, shape[0], 1.0))[shape[0] > 0]
    assert np.ptp(ratio) < 1e-3, "the shape is that of the matches"
    assert abs(ratio.mean() - 1.0) < 0.05 / size
