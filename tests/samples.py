"""Small files of every format that stays readable: a scene bundle, an avatar, a shard and the results of an evaluation.

`python -m tests.samples` writes those of this version into tests/golden/samples/VERSION, with what they hold in
`content.json`. The folder of a released version is never written again: `tests/test_samples.py` opens it for ever.
Before the release, `--update` replaces it.
"""

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import readygo
from readygo.apps.fleet.run import begin, run_in_process
from readygo.common.avatars import load_avatar
from readygo.common.avatars.file import avatar_hash, save_avatar
from readygo.common.dataset import Dataset, validate
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.messages import Split
from readygo.common.scenes import Scene, load_scene, save_scene
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.evaluation import (
    evaluation_settings,
    evaluation_world,
    make_evaluator,
    make_request,
    summarize,
)
from readygo.runs.folder import RunFolder
from readygo.runs.spec import make_spec
from readygo.services.evaluator import handle_evaluate, open_results
from readygo.services.evaluator.results import read_results
from tests.common.maps.room import sheet
from tests.common.scenes.small_room import cameras
from tests.services.animator.bodies import make_avatar

FOLDER = Path(__file__).parent / "golden" / "samples"
CONTENT = "content.json"
SETTINGS = """
[robot.camera]
height_px = 24
width_px = 32
[episode]
goal_distance_min_m = 1.5
goal_distance_max_m = 2.5
time_limit_s = 6.0
human_count_min = 1
human_count_max = 1
[renderer]
outputs = ["rgb", "depth"]
"""


def write_samples(folder: Path) -> None:
    """Write files of every format, and what they hold."""
    scene = save_scene(
        _coarse_room(),
        sheet((-50, -50, -5), (100, 0, 0), (0, 100, 0), spacing_m=20),
        folder / "scene",
        name="room",
        license="CC0-1.0",
        views=cameras(),
    )
    (folder / "avatars").mkdir()
    save_avatar(make_avatar("walker"), folder / "avatars" / "walker.npz")
    with tempfile.TemporaryDirectory() as place:
        settings = Path(place) / "run.toml"
        settings.write_text(SETTINGS)
        config = load_run_config(settings)
    _record(scene, config, folder)
    _evaluate(scene, config, folder)
    (folder / CONTENT).write_text(json.dumps(content_of(folder), indent=1) + "\n")


def _coarse_room() -> GaussianCloud:
    """Floor and walls of a room of 4 x 3 m, in few Gaussians."""
    x, y, z = (4.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 0.0, 2.2)
    sides = [((0, 0, 0), x, y), ((0, 0, 0), x, z), (y, x, z), ((0, 0, 0), y, z), (x, y, z)]
    return concatenate([sheet(*side, spacing_m=0.15) for side in sides])


def _record(scene: Scene, config: RunConfig, folder: Path) -> None:
    data = RunFolder(folder / "data")
    spec = make_spec(scene, folder / "avatars", config, seed=3, split=Split.TRAIN, static=False)
    begin(spec, data.path, 1)
    run_in_process(data, lambda status: None)
    shutil.rmtree(data.state)
    shutil.rmtree(scene.path / "cache")


def _evaluate(scene: Scene, config: RunConfig, folder: Path) -> None:
    world = evaluation_world(str(scene.path), config, avatars=folder / "avatars", seed=3)
    request = make_request(1, ("static", "dynamic"), ("expert", "straight-line"), Split.TEST, 3)
    evaluator = make_evaluator(world)
    with open_results(folder / "results", evaluation_settings(world, request, policy="", camera="policy")) as results:
        results.finish(summarize(handle_evaluate(evaluator, request, results=results), request, evaluator))


def content_of(folder: Path) -> dict[str, Any]:
    """What the files of a version hold, as plain values."""
    scene, dataset = load_scene(folder / "scene"), Dataset(folder / "data")
    avatar = load_avatar(folder / "avatars" / "walker.npz")
    assert scene.sky is not None
    assert scene.views is not None
    assert dataset.robot is not None
    with read_results(folder / "results") as results:
        actions = results.actions(results.records)
        evaluation = {
            "settings": {name: results.settings()[name] for name in ("scene", "seed", "split", "control_hz")},
            "records": [record.to_mapping() for record in results.records.values()],
            "actions": {f"{task.value} {method}": len(rows) for (task, method, _), rows in actions.items()},
        }
    return {
        "scene": {
            "name": scene.name,
            "license": scene.license,
            "content_hash": scene.content_hash,
            "gaussians": [len(scene.cloud), len(scene.sky)],
            "cameras": len(scene.views),
            "free_cells": [int((~each.occupied).sum()) for each in (scene.maps.robot, scene.maps.human)],
            "floor_m": round(float(scene.maps.floor.height_m.mean()), 4),
        },
        "avatar": {"name": avatar.name, "hash": avatar_hash(avatar), "height_m": round(avatar.height_m, 4)},
        "data": {
            "content_hash": dataset.content_hash,
            "sound": validate(folder / "data").ok,
            "seed": dataset.provenance.seed,
            "scene": dataset.provenance.scene.hash,
            "avatars": {name: each.hash for name, each in dataset.provenance.avatars.items()},
            "robot": [dataset.robot.radius_m, dataset.robot.camera.width_px],
            "outputs": list(dataset.outputs),
            "samples": len(dataset),
            "image": list(dataset.decode(0).shape),
            "depth": list(dataset.decode_output(0, "depth").shape),
            "driven_m": round(float(dataset.actions[:, 0].sum()) * dataset.clock.dt_s, 4),
            "goal_m": [round(float(value), 4) for value in dataset.goals_xy_m[0]],
            "human_m": [round(float(value), 4) for value in dataset.humans_of(0)[0][0]],
            "joints": list(dataset.joints_m(0).shape),
        },
        "results": evaluation,
    }


def main() -> int:
    """Write the samples of this version."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--update", action="store_true", help="replace what is there: before the release only")
    folder = FOLDER / readygo.__version__
    if folder.exists():
        if not parser.parse_args().update:
            sys.stderr.write(f"{folder} exists; a released version's samples stay as they are\n")
            return 1
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    write_samples(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
