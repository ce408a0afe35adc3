"""GNM, ViNT and NoMaD: a folder per trajectory, with numbered images and a pickle of positions and yaws.

    data/000003-train-0-000003/0.jpg ... traj_data.pkl     {"position": (T, 2) [m], "yaw": (T,) [rad]}, in the world
    data_splits/train/traj_names.txt, data_splits/test/    names of the trajectories; `val` and `test` are their "test"
    data_config.yaml                                       the entry for their data_config.yaml

Layout: https://github.com/robodhruv/visualnav-transformer, README ("Data Processing") and `vint_dataset.py`. The
images are recorded at 4 Hz, as theirs are.
"""

import pickle
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from readygo.apps.export.source import ExportedEpisode, ExportPart, ExportSource
from readygo.common.errors import DatasetError
from readygo.common.files import unfinished_folder, write_whole
from readygo.common.messages import Split

_NEW_NUMPY, _ANY_NUMPY = b"cnumpy._core.multiarray\n", b"cnumpy.core.multiarray\n"


def write(source: ExportSource, part: ExportPart, out: Path) -> Mapping[str, Any]:
    """Write the trajectories of a part."""
    lengths_m = [_write_trajectory(source.episode(number), out / "data") for number in part.episodes]
    rows = sum(len(source.episode(number)) - 1 for number in part.episodes)
    return {"length_m": sum(lengths_m), "steps": rows}


def finish(source: ExportSource, out: Path, facts: Sequence[Any]) -> None:
    """Write the splits, and the entry for the trainer's configuration."""
    theirs = {"train": (Split.TRAIN,), "test": (Split.VAL, Split.TEST)}
    for name, splits in theirs.items():
        names = [source.episode(number).name for split in splits for number in source.of_split(split)]
        text = "".join(f"{name}\n" for name in names)
        write_whole(out / "data_splits" / name / "traj_names.txt", text, raises=DatasetError)
    spacing_m = sum(part["length_m"] for part in facts) / max(1, sum(part["steps"] for part in facts))
    config = f"readygo:\n  metric_waypoint_spacing: {spacing_m:.3f}  # metres from image to image, on average\n"
    write_whole(out / "data_config.yaml", config, raises=DatasetError)


def _write_trajectory(episode: ExportedEpisode, out: Path) -> float:
    """Write one trajectory; returns the length of its path [m]."""
    poses = episode.dataset.poses[episode.samples]
    with unfinished_folder(out / episode.name, good=lambda: False, raises=DatasetError) as folder:
        for number, image in enumerate(episode.images()):
            # Their loader requires this extension, and detects the format from the content.
            (folder / f"{number}.jpg").write_bytes(image)
        (folder / "traj_data.pkl").write_bytes(_pickle({"position": poses[:, :2].copy(), "yaw": poses[:, 3].copy()}))
    return float(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum())


def _pickle(value: Any) -> bytes:
    """A pickle for all versions of NumPy: since 2.0 pickled arrays name a module that older versions lack."""
    return pickle.dumps(value, protocol=3).replace(_NEW_NUMPY, _ANY_NUMPY)
