"""How well trained perception sees the people of recorded data that it did not learn from.

    python -m experiments.policy.perceived DATA PERCEPTION [PERCEPTION ...] [--scene SCENE] [--images 4000]

DATA is a data folder of the robot that perception was trained for, recorded with people or in a scene that it does not
know; PERCEPTION is a folder of `readygo train --recipe perception`. Prints one line of JSON for each, on the same
images: the measures of `PerceptionMetrics`, and under `tracks` those of `TrackMeasures`, on all images.
"""

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.torch

from experiments.policy.tracks import measure_tracks
from readygo.common.dataset import Dataset
from readygo.common.errors import PolicyError
from readygo.common.perception.artifact import WEIGHTS_FILE, PerceptionSpec, load_perception_spec
from readygo.common.scenes import Scene
from readygo.runs.perception import scene_of
from readygo.services.trainer.config import PERCEPTION_WIDTHS
from readygo.services.trainer.perception.looks import Looks, RecordedScene, looks_of
from readygo.services.trainer.perception.network import PerceptionNet
from readygo.services.trainer.perception.train import measure, perceive


def looked_at(dataset: Dataset, scene: Scene, perceptions: Sequence[Path]) -> Looks:
    """The images of the data, with labels.

    Raises:
        PolicyError: If a network was trained for another camera than the data's, or for other frames.
    """
    specs = [load_perception_spec(folder) for folder in perceptions]
    for folder, spec in zip(perceptions, specs, strict=True):
        if dataset.robot is None or spec.robot.camera != dataset.robot.camera:
            raise PolicyError(f"{folder} is of another camera than the data.")
        if spec.spacing_s != specs[0].spacing_s:
            raise PolicyError(f"{folder} sees frames that are {spec.spacing_s:g} s apart, unlike {perceptions[0]}.")
    recorded = RecordedScene(dataset=dataset, blocked=scene.maps.robot, sight=scene.maps.sight)
    return looks_of([recorded], specs[0].robot.camera, specs[0].spacing_s)


def network_of(folder: Path, spec: PerceptionSpec) -> PerceptionNet:
    """The trained network.

    Raises:
        PolicyError: If its weights are missing or broken.
    """
    net = PerceptionNet(spec.robot.camera, tuple(spec.training.get("settings", {}).get("widths", PERCEPTION_WIDTHS)))
    try:
        net.load_state_dict(safetensors.torch.load_file(folder / WEIGHTS_FILE))
    except Exception as error:  # a missing file, safetensors' errors for a broken one, or other shapes
        raise PolicyError(f"{folder / WEIGHTS_FILE} cannot be read: {error}") from error
    return net.eval()


def measures(folder: Path, looks: Looks, images: int) -> dict[str, Any]:
    """Measures of one network on at most `images` images, spread evenly."""
    spec = load_perception_spec(folder)
    net = network_of(folder, spec)
    rows = np.unique(np.linspace(0, len(looks) - 1, images).round().astype(np.int64))
    return dataclasses.asdict(measure(net, looks, rows, spec))


def track_measures(folder: Path, looks: Looks, dataset: Dataset, scene: Scene) -> dict[str, Any]:
    """Measures of the tracks that follow from what one network tells of all images."""
    spec = load_perception_spec(folder)
    answers, _ = perceive(network_of(folder, spec), looks, np.arange(len(looks)), spec)
    return dataclasses.asdict(measure_tracks(answers, looks, dataset, spec.robot, scene.maps))


def main() -> None:
    """Print the measures of every network."""
    parser = argparse.ArgumentParser(description="Perception of data that it did not learn from")
    parser.add_argument("data", type=Path)
    parser.add_argument("perceptions", type=Path, nargs="+")
    parser.add_argument("--scene", action="append", default=[])
    parser.add_argument("--images", type=int, default=4000)
    given = parser.parse_args()
    dataset = Dataset(given.data)
    scene = scene_of(given.data, dataset, given.scene)
    looks = looked_at(dataset, scene, given.perceptions)
    for folder in given.perceptions:
        tracks = track_measures(folder, looks, dataset, scene)
        found = {"perception": str(folder), **measures(folder, looks, given.images), "tracks": tracks}
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
