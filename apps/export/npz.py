"""NumPy: one compressed .npz per episode, images decoded; `episodes.jsonl` lists them.

episodes/000003-train-0-000003.npz    image (T, H, W, 3) uint8, action (T, 2), goal_xy_m (T, 2), ...
episodes.jsonl                        one line per episode: file, rows, outcome, driver, hash
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from readygo.apps.export.common import described, write_json_lines
from readygo.apps.export.source import ExportedEpisode, Part, Source
from readygo.common.errors import DatasetError
from readygo.common.files import unfinished


def write(source: Source, part: Part, out: Path) -> Mapping[str, Any]:
    """Write the episodes of a part."""
    return {"episodes": [_write_episode(source.episode(number), out) for number in part.episodes]}


def finish(source: Source, out: Path, facts: Sequence[Any]) -> None:
    """Write the list of the episodes."""
    write_json_lines(out / "episodes.jsonl", (episode for part in facts for episode in part["episodes"]))


def _write_episode(episode: ExportedEpisode, out: Path) -> dict[str, Any]:
    file = f"episodes/{episode.name}.npz"
    pictures = {
        "image" if output == "rgb" else output: np.stack(
            [episode.dataset.decode_output(int(sample), output) for sample in episode.samples]
        )
        for output in episode.dataset.outputs
    }
    calibration = episode.dataset.calibration(int(episode.samples[0]))
    constant = {name: np.array(value) for name, value in episode.facts.items()}
    arrays: dict[str, Any] = {"K_px": calibration.K_px, **constant, **episode.columns, **pictures}
    with unfinished(out / file, raises=DatasetError) as path:
        np.savez_compressed(path, **arrays)
    return described(episode, file=file)
