from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.camera.captured import CapturedViews
from readygo.common.errors import RunError
from readygo.services.reconstructor.training import memory
from readygo.services.reconstructor.training.config import preset
from readygo.services.reconstructor.training.memory import check_memory, free_bytes, needed_bytes
from readygo.services.reconstructor.training.photos import Posed


def posed(count: int = 70) -> Posed:
    views = CapturedViews(
        images=tuple(f"{number}.png" for number in range(count)),
        sizes_px=np.full((count, 2), (640, 480)),
        K_px=np.tile(np.eye(3), (count, 1, 1)),
        T_world_camera=np.tile(np.eye(4), (count, 1, 1)),
    )
    return Posed(
        views=views,
        folder=Path(),
        points_m=np.zeros((1, 3)),
        points_rgb=np.zeros((1, 3), np.uint8),
        seen=np.empty((0, 2), np.int64),
        moments=np.arange(count),
    )


@pytest.mark.parametrize(
    ("gaussians", "side_px", "surfaces", "measured_mb"),
    [(9000, 640, True, 863), (9000, 320, True, 599), (150_000, 320, True, 880), (150_000, 320, False, 795)],
)
def test_estimate_is_what_was_measured(gaussians: int, side_px: int, surfaces: bool, measured_mb: int) -> None:
    draft = preset("draft")
    settings = replace(
        draft,
        side_max_px=side_px,
        density=replace(draft.density, count_max=gaussians),
        geometry=replace(draft.geometry, enabled=surfaces),
    )
    assert needed_bytes(posed(), settings) / 2**20 == pytest.approx(measured_mb, rel=0.15)


def test_training_that_does_not_fit_is_refused_with_what_to_lower(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "free_bytes", lambda: 3_000_000_000)
    check_memory(posed(), preset("draft"))
    with pytest.raises(
        RunError, match=r"needs about \d\.\d GB .*2,000,000 Gaussians.*3\.0 GB are free.*density.count_max"
    ):
        check_memory(posed(), preset("high"))


def test_free_memory_is_the_least_of_what_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MEMINFO", "LIMIT", "USED"):
        monkeypatch.setattr(memory, name, tmp_path / name)
    assert free_bytes() is None
    (tmp_path / "MEMINFO").write_text("MemTotal: 9000 kB\nMemAvailable: 3000 kB\n")
    assert free_bytes() == 3000 * 1024
    (tmp_path / "USED").write_text("1000\n")
    (tmp_path / "LIMIT").write_text("max\n")
    assert free_bytes() == 3000 * 1024
    (tmp_path / "LIMIT").write_text("5000\n")
    assert free_bytes() == 4000
