from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.reconstruction import surfaces_and_plain
from readygo.apps.capture.truth import Truth
from readygo.common.errors import SceneError


def test_trainings_differ_by_their_surfaces_alone() -> None:
    both = {name: vars(config) for name, config in surfaces_and_plain.settings(300, 160).items()}
    differing = {name for name, value in both["surfaces"].items() if value != both["plain"][name]}
    assert differing == {"geometry"}
    assert both["surfaces"]["geometry"].enabled
    assert not both["plain"]["geometry"].enabled
    assert both["plain"]["steps"] == 300


def test_cameras_are_paired_by_their_images(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = np.stack([np.eye(4) * k for k in (1.0, 2.0)])
    views = SimpleNamespace(images=("000007.jpg", "000002.jpg"), T_world_camera=poses)
    monkeypatch.setattr(surfaces_and_plain, "pinhole_views", lambda _: views)
    frames = [{"image": k, "T_world_camera": (np.eye(4) * 10 * k).tolist()} for k in (2, 3)]
    ((true, ours),) = surfaces_and_plain.camera_pairs(Truth(content={"frames": frames}), Path("posed"))
    assert (true[0, 0], ours[0, 0]) == (20.0, 2.0)
    with pytest.raises(SceneError, match="no cameras of this capture"):
        surfaces_and_plain.camera_pairs(Truth(content={"frames": []}), Path("posed"))


def test_trainings_with_depth_images_differ_by_their_weights_and_one_has_none(tmp_path: Path) -> None:
    arms = surfaces_and_plain.settings(300, 160, (0.0, 2.0))
    assert {name: config.geometry.depth for name, config in arms.items()} == {
        "without depth": surfaces_and_plain.settings(300, 160)["surfaces"].geometry.depth,
        "depth 0": 0.0,
        "depth 2": 2.0,
    }
    for name in ("images", "sparse", "depth"):
        (tmp_path / "posed" / name).mkdir(parents=True)
    for _ in range(2):
        folder = surfaces_and_plain.without_depths(tmp_path / "posed", tmp_path / "links")
        assert sorted(path.name for path in folder.iterdir()) == ["images", "sparse"]
