import json
from pathlib import Path

import numpy as np

from readygo.apps.export import npz
from readygo.apps.export.source import Source


def test_numpy_reads_everything_without_pickles(source: Source, tmp_path: Path) -> None:
    facts = [npz.write(source, part, tmp_path) for part in source.parts(10**9)]
    npz.finish(source, tmp_path, facts)
    rows = [json.loads(line) for line in (tmp_path / "episodes.jsonl").read_text().splitlines()]
    assert [row["rows"] for row in rows] == [21, 10, 6]
    episode = source.episode(1)
    with np.load(tmp_path / rows[1]["file"], allow_pickle=False) as read:
        assert read["image"].shape == (10, 24, 32, 3)
        np.testing.assert_array_equal(read["image"][3], source.dataset.decode(int(episode.samples[3])))
        np.testing.assert_array_equal(read["action"], episode.columns["action"])
        assert read["outcome"] == "success"
        assert read["K_px"].shape == (3, 3)
