"""Trains perception from recorded data and the maps of their scenes."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from readygo.common.config import section_to_mapping
from readygo.common.dataset import Dataset
from readygo.common.errors import ConfigError, DatasetError, RunError, SceneError
from readygo.common.perception import PerceptionSpec
from readygo.common.scenes import Scene
from readygo.runs.folder import RunFolder
from readygo.runs.origin import KEY, origin_of_data
from readygo.runs.scene_argument import open_scene
from readygo.runs.training import torch_needed
from readygo.services.trainer import PerceptionConfig

if TYPE_CHECKING:
    from readygo.services.trainer import PerceptionProgress


def train_perception(
    data: Sequence[Path],
    config: PerceptionConfig,
    out: Path,
    *,
    scenes: Sequence[str] = (),
    show: "Callable[[PerceptionProgress], None]" = lambda _: None,
) -> dict[str, Any]:
    """Train perception, and write its folder; returns the content of `metrics.json`.

    Args:
        data: Data folders, each of one scene.
        config: Budget and settings.
        out: Folder of the network.
        scenes: Scenes of data whose run does not say where theirs is.
        show: Told of the progress.

    Raises:
        PolicyError: If torch or onnx is not installed, `out` belongs to another run, or the network that training
            begins with cannot be used.
        ConfigError: If `out` is that network's folder, or the robot cannot have perception.
        DatasetError: If the data cannot be used.
        SceneError: If the scene of some data is nowhere.
    """
    if config.perception and Path(config.perception).resolve() == out.resolve():
        raise ConfigError(f"{out} would replace the network that it begins with: choose another folder.")
    with torch_needed():
        from readygo.services.trainer import PerceptionRun, RecordedScene, image_bytes, looks_of
    datasets = [Dataset(folder) for folder in data]
    robot = datasets[0].robot
    if robot is None:
        raise DatasetError(f"{data[0]} names no robot; record it with this version.")
    if robot.ranges.varies or robot.cameras:
        raise ConfigError("Perception is trained for one robot with one camera; leave [ranges] and [cameras] out.")
    for folder, dataset in zip(data, datasets, strict=True):
        if dataset.robot != robot:
            raise DatasetError(f"{folder} is of another robot than {data[0]}; train on data of one robot.")
    images = sum(int(dataset.pictured.sum()) for dataset in datasets)
    share = min(1.0, config.memory_mb * 1e6 / max(images * image_bytes(robot.camera), 1))
    recorded = []
    for folder, dataset in zip(data, datasets, strict=True):
        maps = scene_of(folder, dataset, scenes).maps
        recorded.append(RecordedScene(dataset=dataset, blocked=maps.robot, sight=maps.sight))
    looks = looks_of(recorded, robot.camera, config.spacing_s, share=share)
    origin = {KEY: section_to_mapping(origin_of_data(data)), "settings": section_to_mapping(config)}
    spec = PerceptionSpec(robot=robot, spacing_s=config.spacing_s, training=origin)
    hashes = {f"data {number}": dataset.content_hash for number, dataset in enumerate(datasets)}
    return PerceptionRun(looks, spec, config, out, hashes).go(show)


def scene_of(folder: Path, dataset: Dataset, scenes: Sequence[str] = ()) -> Scene:
    """The scene that data were recorded in, as it was then.

    Args:
        folder: Data folder.
        dataset: Its content.
        scenes: Where it may be, besides the place that its run names.

    Raises:
        SceneError: If it is nowhere.
    """
    wanted = dataset.provenance.scene
    try:
        places = [RunFolder(folder).load()[0].scene_path]
    except RunError:
        places = []
    for place in [*scenes, *places]:
        try:
            scene = open_scene(place)
        except SceneError:
            if place in scenes:
                raise
            continue
        if scene.content_hash == wanted.hash:
            return scene
    raise SceneError(f"The scene {wanted.name!r} of {folder} is not where it was, or changed; name it with --scene.")
