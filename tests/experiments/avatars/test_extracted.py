import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from experiments.avatars import extracted
from experiments.avatars.extracted import measured
from readygo.apps.avatar.capture import TRUTH_ARRAYS, TRUTH_FILE
from readygo.apps.avatar.studio import Framing
from readygo.common.avatars import Avatar
from tests.services.reconstructor.avatars.conftest import coarse_body, plain_film

__all__ = ["coarse_body", "plain_film"]


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extracted, "FRAMING", Framing(height_px=64, width_px=64, focal_px=96.0))
    motions = extracted.new_motions
    monkeypatch.setattr(extracted, "new_motions", lambda avatar: {"turn": motions(avatar)["turn"]})


def poses(folder: Path, film: Path, shift_m: float) -> Path:
    """The true poses, of a person who stands elsewhere."""
    true = np.load(film / TRUTH_ARRAYS)
    away = np.array([0.0, 0.0, shift_m], np.float32)
    path = folder / "person.poses.npz"
    np.savez(
        path,
        root_m=true["root_m"] + away,
        pose_axis_angle=true["pose_axis_angle"],
        joints_m=true["joints_m"] + away,
    )
    return path


def test_true_avatar_in_true_poses_has_no_errors(tmp_path: Path, coarse_body: Avatar, plain_film: Path) -> None:
    row, sheets = measured(coarse_body, plain_film, coarse_body, poses(tmp_path, plain_film, 0.0))
    assert (row["joint_error_cm"], row["height_error_cm"]) == (0.0, 0.0)
    assert min(row["held_out_psnr_db"], row["new_poses_psnr_db"]) > 100.0
    assert [sheet.dtype for sheet in sheets] == [np.uint8]
    assert json.loads((plain_film / TRUTH_FILE).read_text())["frames"] == 12


def test_errors_are_those_of_poses_and_of_the_person(tmp_path: Path, coarse_body: Avatar, plain_film: Path) -> None:
    moved, _ = measured(coarse_body, plain_film, coarse_body, poses(tmp_path, plain_film, 0.05))
    assert moved["joint_error_cm"] == pytest.approx(5.0, abs=0.01)
    assert moved["held_out_psnr_db"] < 30.0
    assert moved["new_poses_psnr_db"] > 100.0
    cloud = dataclasses.replace(coarse_body.cloud, sh=coarse_body.cloud.sh + np.float32(0.2))
    other = dataclasses.replace(coarse_body, cloud=cloud, height_m=coarse_body.height_m + 0.03)
    lit, _ = measured(coarse_body, plain_film, other, poses(tmp_path, plain_film, 0.0))
    assert lit["height_error_cm"] == pytest.approx(3.0, abs=0.01)
    assert max(lit["held_out_psnr_db"], lit["new_poses_psnr_db"]) < 30.0
