from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.common.dataset.provenance import Provenance, SceneOrigin
from readygo.common.errors import ConfigError, DatasetError, SceneError
from readygo.common.robot import RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.common.scenes import load_scene
from readygo.runs import perception as module
from readygo.runs.perception import scene_of, train_perception
from readygo.services.trainer import PerceptionConfig


def dataset(scene_hash: str, **fields: object) -> SimpleNamespace:
    origin = SceneOrigin(name="hall", hash=scene_hash)
    given = {"robot": RobotConfig(), "content_hash": "c", "provenance": Provenance(scene=origin), **fields}
    return SimpleNamespace(**given)


def test_scene_is_found_where_it_is_named(embedded_bundle: Path, tmp_path: Path) -> None:
    scene = load_scene(embedded_bundle)
    found = scene_of(tmp_path, dataset(scene.content_hash), [str(embedded_bundle)])  # type: ignore[arg-type]
    assert found.content_hash == scene.content_hash


def test_scene_that_is_nowhere_or_changed_is_named(embedded_bundle: Path, tmp_path: Path) -> None:
    for places in ([], [str(embedded_bundle)]):
        with pytest.raises(SceneError, match=r"The scene 'hall' of .* name it with --scene"):
            scene_of(tmp_path, dataset("f" * 64), places)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="does not exist"):
        scene_of(tmp_path, dataset("f" * 64), [str(tmp_path / "nowhere")])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("robots", "error", "words"),
    [
        ([None], DatasetError, "names no robot"),
        ([RobotConfig(ranges=RobotRanges(radius_m=(0.2, 0.3)))], ConfigError, "one robot with one camera"),
        ([RobotConfig(), RobotConfig(radius_m=0.2)], DatasetError, "another robot"),
    ],
)
def test_data_that_do_not_fit_are_refused(
    robots: list[RobotConfig | None],
    error: type[Exception],
    words: str,
    embedded_bundle: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = load_scene(embedded_bundle)
    made = {Path(f"data{k}"): dataset(scene.content_hash, robot=robot) for k, robot in enumerate(robots)}
    monkeypatch.setattr(module, "Dataset", lambda folder: made[folder])
    monkeypatch.setattr("readygo.services.trainer.looks_of", lambda *_: None, raising=False)
    with pytest.raises(error, match=words):
        train_perception([*made], PerceptionConfig(), tmp_path / "out", scenes=[str(embedded_bundle)])
    assert not (tmp_path / "out").exists()


def test_network_that_training_begins_with_is_not_replaced(tmp_path: Path) -> None:
    config = PerceptionConfig(perception=str(tmp_path / "a" / ".." / "perception"))
    with pytest.raises(ConfigError, match="would replace the network that it begins with"):
        train_perception([tmp_path / "data"], config, tmp_path / "perception")
