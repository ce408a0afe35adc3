import math
import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.export import gnm
from readygo.apps.export.source import ExportSource
from tests.crooked import ODD_RATES, crooked_episode


def test_loader_of_the_published_layout_finds_images_and_poses(data: Path, tmp_path: Path) -> None:
    source = ExportSource([data], 4)
    gnm.finish(source, tmp_path, [gnm.write(source, part, tmp_path) for part in source.parts(10**9)])
    names = (tmp_path / "data_splits" / "train" / "traj_names.txt").read_text().split()
    assert names == ["000000-train-7-000000", "000001-train-7-000002"]
    assert (tmp_path / "data_splits" / "test" / "traj_names.txt").read_text().split() == ["000002-val-7-000004"]
    folder = tmp_path / "data" / names[0]
    trajectory = pickle.loads((folder / "traj_data.pkl").read_bytes())
    samples = source.episode(0).samples
    np.testing.assert_array_equal(trajectory["position"], source.dataset.poses[samples, :2])
    np.testing.assert_array_equal(trajectory["yaw"], source.dataset.poses[samples, 3])
    images = sorted(folder.glob("*.jpg"), key=lambda path: int(path.stem))
    assert [path.read_bytes() for path in images] == [source.dataset.image(int(sample)) for sample in samples]
    assert "metric_waypoint_spacing: 0." in (tmp_path / "data_config.yaml").read_text()


def test_pickle_names_no_module_that_old_numpy_lacks(data: Path, tmp_path: Path) -> None:
    source = ExportSource([data], 4)
    gnm.write(source, source.parts(10**9)[0], tmp_path)
    assert all(b"numpy._core" not in path.read_bytes() for path in tmp_path.rglob("traj_data.pkl"))


def test_spacing_is_the_mean_way_between_images_of_all_trajectories(
    crooked_source: ExportSource, tmp_path: Path
) -> None:
    facts = [gnm.write(crooked_source, part, tmp_path) for part in crooked_source.parts(1)]
    assert len(facts) == 2
    gnm.finish(crooked_source, tmp_path, facts)
    length_m, steps = 0.0, 0
    for index in (3, 8):
        _, samples = crooked_episode(index, 9 + index, robot=ODD_RATES)
        places = [sample.robot_xyzyaw[:2] for sample in samples[::2]]
        length_m += sum(math.dist(a, b) for a, b in pairwise(places))
        steps += len(places) - 1
    (line,) = [row for row in (tmp_path / "data_config.yaml").read_text().splitlines() if "spacing" in row]
    assert float(line.split()[1]) == pytest.approx(length_m / steps, abs=6e-4)
    assert length_m > 0.1
