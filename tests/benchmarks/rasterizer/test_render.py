import json

import numpy as np
import pytest

from readygo.apps.cli import parse
from readygo.benchmarks.rasterizer import runs as render_run
from readygo.benchmarks.rasterizer.render import BenchAvatarOptions, BenchRenderOptions, bench_render, speed
from readygo.benchmarks.rasterizer.runs import STAGES, Timing
from readygo.commands import COMMANDS
from readygo.common.errors import ConfigError


def test_command_prints_one_json_object_with_units(capsys: pytest.CaptureFixture[str]) -> None:
    options = "--synthetic 3k --avatar-gaussians 1k --size 48x64 --frames 16 --views 2 --json"
    parse(COMMANDS, ["bench", "render", *options.split()])()
    result = json.loads(capsys.readouterr().out)
    assert result["image_px"] == [48, 64]
    assert result["avatar_gaussians"] == [1000, 1000]
    assert result["frames"] == 16
    assert 0 < result["gaussians"] <= 3000
    assert result["sh_degree"] == 3
    assert result["images_per_s"] == pytest.approx(1e3 / result["ms_per_image"])
    assert set(result["stages_ms"]) == {*STAGES, "everything_else"}
    assert set(result["bound_stages_ms"]) < set(result["stages_ms"])
    assert result["share_of_bound"] == pytest.approx(sum(result["bound_stages_ms"].values()) / result["ms_per_image"])
    assert result["peers"]["reference"]["images_per_s"] > 0
    assert result["peers"]["reference"]["psnr_db"] > 45


def test_table_names_stages_bound_and_peer(capsys: pytest.CaptureFixture[str]) -> None:
    bench_render(
        BenchRenderOptions(
            synthetic="3k", size="48x64", frames=16, views=2, pedestrians=BenchAvatarOptions(avatar_gaussians="1k")
        )
    )
    text = capsys.readouterr().out
    for word in ("images_per_s", *STAGES, "bound_images_per_s", "share_of_bound", "reference", "psnr_db"):
        assert word in text


def test_without_a_gpu_no_number_is_made_up(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(render_run, "_has_gpu", lambda: False)
    bench_render(BenchRenderOptions(synthetic="3k", backend="gpu", json=True))
    result = json.loads(capsys.readouterr().out)
    assert result["images_per_s"] is None
    assert result["why_none"] == "no gpu"
    assert "images_per_s_wall" not in result
    bench_render(BenchRenderOptions(synthetic="3k", backend="gpu"))
    assert "images_per_s               no gpu" in capsys.readouterr().out


def test_what_cannot_be_measured_is_said_in_one_line() -> None:
    for options, message in (
        ({"size": "144"}, "HEIGHTxWIDTH"),
        ({"size": "4x4"}, "8..4095"),
        ({"lod": "on", "backend": "reference"}, "--lod on"),
        ({"scene": "a", "synthetic": "3k"}, "exclude each other"),
        ({"synthetic": "many"}, "1k to 100M"),
        ({"avatars": 9}, "0 to 8"),
        ({"avatars": -1}, "negative"),
        ({"frames": 0}, "at least 1"),
    ):
        with pytest.raises(ConfigError, match=message) as caught:
            bench_render(BenchRenderOptions(**{"synthetic": "3k", **options}))
        assert "\n" not in str(caught.value)


def test_speed_takes_the_fastest_run_and_adds_processes_up() -> None:
    cpu_s = np.array([[[0.02, 0.04]], [[0.03, 0.02]]])
    one = speed([Timing(cpu_s=cpu_s, wall_s=2 * cpu_s)])
    assert one["images_per_s"] == pytest.approx(50.0)
    assert one["images_per_s_wall"] == pytest.approx(4 / 0.22)
    two = speed([Timing(cpu_s=cpu_s, wall_s=2 * cpu_s)] * 2)
    assert two["images_per_s"] == pytest.approx(100.0)
    assert two["ms_per_image"] == pytest.approx(20.0)
    assert two["images_per_s_per_core"]["median"] == pytest.approx(50.0)
