from pathlib import Path

import pytest

from experiments.reconstruction import poses
from readygo.apps.capture.truth import write_truth
from readygo.common.errors import SceneError


def test_folder_without_poses_is_refused(tmp_path: Path) -> None:
    write_truth(tmp_path / "a.truth.json", {"frames": [], "marker": None})
    with pytest.raises(SceneError, match="holds no poses"):
        poses.measured(tmp_path / "a.truth.json", tmp_path)
