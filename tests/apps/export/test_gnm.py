import pickle
from pathlib import Path

import numpy as np

from readygo.apps.export import gnm
from readygo.apps.export.source import Source


def test_loader_of_the_published_layout_finds_images_and_poses(data: Path, tmp_path: Path) -> None:
    source = Source([data], 4)
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
    source = Source([data], 4)
    gnm.write(source, source.parts(10**9)[0], tmp_path)
    assert all(b"numpy._core" not in path.read_bytes() for path in tmp_path.rglob("traj_data.pkl"))
