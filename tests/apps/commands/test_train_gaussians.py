"""`readygo scene train` as users call it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps.cli import run_command
from readygo.apps.commands import train_gaussians as command
from readygo.commands import COMMANDS
from readygo.services.reconstructor.training.config import preset


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["scene", "train", "nowhere", "--out", "out"], "nowhere needs images/ and a COLMAP model"),
        (["scene", "train", "nowhere", "--out", "out", "--steps", "0"], "steps must be at least 1"),
        (
            ["scene", "train", "nowhere", "--out", "out", "--density.count-max", "5"],
            "--density.count-max must be at least 100",
        ),
        (["scene", "train", "nowhere", "--out", "out", "--device", "tpu"], "tpu"),
    ],
)
def test_mistakes_end_in_one_line(
    argv: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, argv)
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out" / "gaussians.ply").exists()


@pytest.mark.parametrize("begun", [True, False])
def test_ctrl_c_names_the_state_where_there_is_any(
    begun: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(posed: Path, out: Path, *_: object) -> None:
        if begun:
            out.mkdir()
            (out / "checkpoint.npz").touch()
        raise KeyboardInterrupt

    monkeypatch.setattr("readygo.services.reconstructor.train_gaussians", interrupted)
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, ["scene", "train", str(tmp_path), "--out", str(out)])
    assert stop.value.code == 130
    words = f"the same command resumes from the state in {out}." if begun else "nothing is saved yet."
    assert capsys.readouterr().err.splitlines()[-1] == f"readygo: stopped; {words}"


REPORT = {
    "seconds": {"images": 1.26, "steps": 30.5}, "gaussians": 98765, "images": 40,
    "psnr_db": 25.678, "psnr_fitted_db": 26.5, "ssim": 0.8126, "notes": ["9 alone"],
    "gpu_bytes": 2_340_000_000,
    "held_out": [{"image": "9.jpg", "psnr_db": 19.996, "psnr_fitted_db": 20.25, "ssim": 0.7}],
}  # fmt: skip


def test_settings_are_those_of_the_preset_but_for_what_is_named(tmp_path: Path, monkeypatch, capsys) -> None:
    asked = []
    density, geometry = {"count_max": 4567, "method": "mcmc"}, {"enabled": False, "distance_max_m": 0.3}
    keys = {"steps": 123, "batch": 3, "side_max_px": 321, "hold_out": 7, "device": "cuda", "seed": 9}
    keys |= {"density": density, "geometry": geometry}
    monkeypatch.setattr(command, "_train", lambda *words: asked.append(words) or REPORT)
    command.scene_train(command.SceneTrainOptions(posed=tmp_path, out=tmp_path / "out"))
    command.scene_train(
        command.SceneTrainOptions(posed=tmp_path, out=tmp_path / "out", preset="standard", keys=keys, json=True)
    )
    (posed, out, plain, _), (_, _, own, _) = asked
    assert (posed, out, plain) == (tmp_path, tmp_path / "out", preset("draft"))
    assert (own.steps, own.batch, own.side_max_px, own.hold_out, own.device, own.seed) == (123, 3, 321, 7, "cuda", 9)
    assert (own.density.count_max, own.density.method) == (4567, "mcmc")
    assert (own.geometry.enabled, own.geometry.distance_max_m) == (False, 0.3)
    command.scene_train(command.SceneTrainOptions(posed=tmp_path, out=tmp_path / "out", bare_walls=True))
    assert asked[2][2] == command.weak_texture(preset("draft"))


def test_report_is_told_in_rows() -> None:
    seconds = [("images", "1.3 s"), ("steps", "30.5 s"), ("in all", "31.8 s")]
    assert command._rows(REPORT) == [
        ("Gaussians", "98,765 of 40 images"),
        ("held out", "25.68 dB (26.50 dB with fitted colours), SSIM 0.813"),
        ("9.jpg", "20.00 dB (20.25 dB with fitted colours), SSIM 0.700"),
        ("note", "9 alone"), *seconds, ("memory of the GPU", "2.3 GB"),
    ]  # fmt: skip
    assert command._rows({**REPORT, "psnr_db": None, "gpu_bytes": 0, "notes": []}) == [
        ("Gaussians", "98,765 of 40 images"),
        *seconds,
    ]


def test_progress_tells_the_search_and_the_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch", reason="torch is not installed")
    from readygo.services.reconstructor.training import train
    from readygo.services.reconstructor.training.progress import TrainingProgress

    lines: list[str] = []

    @contextmanager
    def status(_: str) -> Iterator[SimpleNamespace]:
        yield SimpleNamespace(update=lines.append)

    def run(posed: Path, out: Path, settings: object, tell: Callable[[TrainingProgress], None]) -> dict[str, int]:
        at = TrainingProgress(
            step=30, steps=90, gaussians=1234, loss=0.1, psnr_db=25.04, seconds=3.0, picture=None, searches=True
        )
        tell(at)
        tell(replace(at, searches=False))
        return {}

    monkeypatch.setattr("readygo.services.reconstructor.train_gaussians", run)
    monkeypatch.setattr(train, "train_gaussians", run)
    notes = SimpleNamespace(status=status)
    command._train(tmp_path, tmp_path / "out", preset("draft"), notes)  # type: ignore[arg-type]
    assert lines == [
        "searching for what moved, step 30 of 90",
        "step 30 of 90, 1,234 Gaussians, loss 0.1000, held out 25.04 dB, 3 s",
    ]
