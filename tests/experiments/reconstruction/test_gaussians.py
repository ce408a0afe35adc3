from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="torch is not installed")

from experiments.reconstruction import gaussians
from readygo.services.reconstructor.training.config import GaussiansConfig
from readygo.services.reconstructor.training.progress import TrainingProgress


def test_late_steps_are_measured_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    clock = {"cpu": 0.0}
    monkeypatch.setattr(gaussians.time, "process_time", lambda: clock["cpu"])

    def train(posed: Path, out: Path, config: GaussiansConfig, hear: Any) -> dict[str, Any]:
        for step in (50, 80, 90, 100):
            clock["cpu"] = 10.0 * step if step < 80 else 500.0 + 0.5 * step
            hear(TrainingProgress(step=step, steps=100, gaussians=7, loss=0.1, psnr_db=None, seconds=1.0, picture=None))
        return {"gaussians": 7, "psnr_db": 25.0, "ssim": 0.9, "held_out": [{"image": "a"}], "seconds": {}}

    monkeypatch.setattr(gaussians, "train_gaussians", train)
    config = gaussians.settings(steps=100, gaussians=500, batch=2, side_px=64, hold_out=14)
    result = gaussians.measured(tmp_path, tmp_path, config)
    assert result["late_step_cpu_s"] == pytest.approx(0.5)
    assert result["late_views_per_cpu_s"] == pytest.approx(4.0)
    assert (result["psnr_db"], result["held_out"]) == (25.0, ["a"])
    assert config.density.count_max == 500
