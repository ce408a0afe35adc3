import io
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from readygo.apps.cli import run_command
from readygo.apps.commands import reconstruct
from readygo.apps.terminal import PlainConsole
from readygo.commands import COMMANDS
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.reconstruct import Job
from readygo.services.reconstructor.stages import Say, StageProgress


def test_marker_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "marker.pdf"
    run_command(COMMANDS, ["marker", "--size-m", "0.2", "--out", str(out)])
    assert out.read_bytes().startswith(b"%PDF-1.4")
    assert "0.2 m wide" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["marker", "--size-m", "2", "--out", "m.pdf"], "A3"),
        (["marker", "--size-m", "0.2", "--out", "m.txt"], "--out m.txt must end in .pdf."),
        (["scene", "poses", "no.mp4", "--scale", "-1", "--out", "out"], "scale must be at least 0"),
        (["scene", "poses", "no.mp4", "--out", "out"], "no.mp4 does not exist; give a video"),
        (["reconstruct", "no.mp4", "--scale", "1", "--out", "."], "--out must be the name of a new folder, got ."),
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
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("kept", "words"), [(True, "finished stages stay in"), (False, "stopped; nothing is saved yet.")]
)
def test_ctrl_c_names_the_work_folder_where_something_of_it_is_there(
    kept: bool, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(job: Job, config: ReconstructorConfig, say: Say) -> dict[str, Any]:
        if kept:
            job.work.mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr(reconstruct, "reconstruct_scene", interrupted)
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, ["reconstruct", "walk.mp4", "--scale", "1", "--out", str(tmp_path / "lobby")])
    assert stop.value.code == 130
    said = capsys.readouterr().err
    assert words in said
    assert ("lobby.work" in said) == kept


REPORT = {
    "verdict": {
        "registered": 38, "images": 41, "registered_share": 0.927, "components": [30, 8], "points": 12345,
        "reprojection_px": 0.567, "drift": "1 cm", "notes": [],
    },
    "scale": {"metres_per_unit": 0.0123456, "interval_percent": 0.226, "source": "marker 0"},
    "up": "+y", "markers": [{"marker": 3, "side_m": 0.19996, "views": 17, "residual_px": 0.346}],
    "notes": ["it <leans>"], "removed": "floaters: 12", "sky": 3456,
    "training": {
        "psnr_db": 25.678, "psnr_fitted_db": 27.1, "notes": ["9 of 35 are <alone>"], "ssim": 0.8126,
        "held_out": [1, 2, 3], "gaussians": 98765, "images": 35, "unseen": 4321
    },
    "seconds": {"poses": 61.4, "gaussians": 300.6},
}  # fmt: skip


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """What is printed, in lines that are long enough."""
    file = io.StringIO()
    monkeypatch.setattr(reconstruct, "PlainConsole", lambda **_: PlainConsole(file=file, width=160))
    return file


def test_scene_is_told_as_it_was(tmp_path: Path, wide: io.StringIO, golden_page: Callable[[str, str], None]) -> None:
    job = Job(source=Path("walk.mp4"), out=Path("lobby"), work=Path("lobby.work"), license="")
    reconstruct._print_scene(Path("in/walk.mp4"), job, REPORT)
    unknown = REPORT | {"scale": REPORT["scale"] | {"interval_percent": None}, "markers": [], "notes": []}
    unknown |= {"training": REPORT["training"] | {"psnr_db": None}}
    reconstruct._print_scene(Path("in/walk.mp4"), job, unknown)
    golden_page("reconstruct", wide.getvalue())


def test_poses_and_scenes_are_made_as_they_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wide: io.StringIO, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(reconstruct, "find_poses", lambda *words: asked.append(words[:3]) or REPORT)
    monkeypatch.setattr(reconstruct, "reconstruct_scene", lambda *words: asked.append(words[:2]) or REPORT)
    monkeypatch.setattr(reconstruct, "ask_worker", lambda *words: asked.append(words[:3]) or REPORT)
    monkeypatch.setattr(reconstruct, "scene_report", lambda options: asked.append(options.scene))
    source, out = tmp_path / "walk.mp4", tmp_path / "lobby"
    keys: dict[str, Any] = {
        "metric": {"marker_ids": [4, 5], "marker_on": "wall"},
        "frames": {"count_max": 77},
        "poses": {"mapper": "global", "threads": 3},
    }
    more: dict[str, Any] = {"marker_size_m": 0.3, "length": ("a=1",), "json": True}
    reconstruct.scene_poses(reconstruct.ScenePosesOptions(source=source, out=out, **more, keys=keys))
    assert json.loads(capsys.readouterr().out) == REPORT
    footage = reconstruct.FootageOptions(intrinsics="9 9 4 3", masks=tmp_path / "masks")
    reconstruct.scene_poses(reconstruct.ScenePosesOptions(source=source, out=out, scale=2.5, footage=footage))
    gaussians = {"steps": 123, "side_max_px": 456, "device": "cuda", "geometry": {"enabled": False}}
    reconstruct.reconstruct_command(
        reconstruct.ReconstructOptions(
            source=source, out=out, **more, license="CC0", keys={**keys, "gaussians": gaussians}
        )
    )
    reconstruct.reconstruct_command(
        reconstruct.ReconstructOptions(source=source, out=out, scale=1.0, work=tmp_path / "w", listen="tcp/lab:1")
    )
    poses, scaled, made, elsewhere, reported = asked
    assert poses[:2] == (source, out)
    metric = poses[2].metric
    assert (metric.marker_size_m, metric.marker_ids, metric.marker_on, metric.lengths) == (
        0.3,
        (4, 5),
        "wall",
        ("a=1",),
    )
    assert (poses[2].frames.count_max, poses[2].poses.mapper, poses[2].poses.threads) == (77, "global", 3)
    assert scaled[2].metric.scale == 2.5
    assert (scaled[2].poses.intrinsics, scaled[2].poses.fixes_lens) == ("9 9 4 3", True)
    assert scaled[2].frames.masks == str(tmp_path / "masks")
    job, config = made
    assert (job.source, job.out, job.work, job.license) == (source, out, tmp_path / "lobby.work", "CC0")
    own = config.gaussians
    assert (own.steps, own.side_max_px, own.device, own.geometry.enabled) == (
        123,
        456,
        "cuda",
        False,
    )
    assert config.metric == metric
    assert (elsewhere[0].work, elsewhere[2], reported) == (tmp_path / "w", "tcp/lab:1", str(out))
    assert elsewhere[1].gaussians.geometry.enabled


def test_stages_are_told_when_they_begin_and_every_30_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now_s = [5.0]
    monkeypatch.setattr(reconstruct, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    lines = reconstruct.Lines(("frames", "poses"))
    for at_s, stage, share, words in (
        (5.0, "frames", 0.0, ""), (5.25, "poses", 0.1, "a"), (35.0, "poses", 0.2, "b"), (35.25, "poses", 0.256, "<c>"),
        (65.0, "poses", 0.3, "d"), (65.25, "poses", 0.9, "e"),
    ):  # fmt: skip
        now_s[0] = at_s
        lines.say(StageProgress(stage=stage, share=share, words=words))
    assert capsys.readouterr().err.splitlines() == [
        "[1/2] frames ...", "[2/2] poses 10 %: a", "[2/2] poses 26 %: <c>", "[2/2] poses 90 %: e"
    ]  # fmt: skip
