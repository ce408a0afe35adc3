"""An extraction gives an avatar with its measures, resumes, and refuses what cannot be a person."""

import signal
from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.errors import AvatarError
from readygo.services.reconstructor.avatars.body import swap_sides
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.extract import (
    CHECKPOINT_FILE,
    Extraction,
    ExtractionProgress,
    extract_avatar,
    forget_extraction,
)

CONFIG = AvatarFitConfig(steps=24, hold_out=6, gaussians_max=2000)


def _extract(film: Path, work: Path, body: Avatar, tell: "object" = lambda _: None) -> Extraction:
    return extract_avatar(
        film,
        work,
        CONFIG,
        tell,
        name="someone",
        license_text="none",
        bodies={body.name: body},  # type: ignore[arg-type]
    )


def test_interrupted_extraction_resumes_to_the_same_result(
    neuman_film: Path, coarse_body: Avatar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = _extract(neuman_film, tmp_path / "whole", coarse_body)
    assert whole.report["frames"] == 12
    assert [each.image for each in whole.held_out] == ["00000.png", "00006.png"]
    assert whole.report["psnr_db"] == pytest.approx(np.mean([each.psnr_db for each in whole.held_out]), abs=1e-3)
    assert whole.report["psnr_db"] > 12.0
    assert whole.joints_m.shape == (12, 24, 3)

    def interrupt(at: ExtractionProgress) -> None:
        if at.step == 10:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("readygo.services.reconstructor.avatars.extract._TELL_EVERY_S", 0.0)
    with pytest.raises(KeyboardInterrupt):
        _extract(neuman_film, tmp_path / "work", coarse_body, interrupt)
    assert (tmp_path / "work" / CHECKPOINT_FILE).is_file()
    steps: list[int] = []
    resumed = _extract(neuman_film, tmp_path / "work", coarse_body, lambda at: steps.append(at.step))
    assert steps[0] > 10
    np.testing.assert_array_equal(resumed.avatar.cloud.means_m, whole.avatar.cloud.means_m)
    np.testing.assert_array_equal(resumed.pose_axis_angle, whole.pose_axis_angle)
    forget_extraction(tmp_path / "work")
    assert not (tmp_path / "work").exists()


def test_swapped_sides_and_strange_poses_leave_nothing(own_film: Path, coarse_body: Avatar, tmp_path: Path) -> None:
    work = tmp_path / "work"
    poses = dict(np.load(own_film / "poses.npz"))
    np.savez(own_film / "poses.npz", root_m=poses["root_m"], pose_axis_angle=swap_sides(poses["pose_axis_angle"]))
    with pytest.raises(AvatarError, match="sides of the joints are swapped"):
        _extract(own_film, work, coarse_body)
    np.savez(own_film / "poses.npz", root_m=poses["root_m"] + [1.0, 0.0, 0.0], pose_axis_angle=poses["pose_axis_angle"])
    with pytest.raises(AvatarError, match="look at the cameras"):
        _extract(own_film, work, coarse_body)
    assert not work.exists()
