import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.cli import parse
from readygo.benchmarks.rasterizer import render
from readygo.benchmarks.rasterizer import runs as render_run
from readygo.benchmarks.rasterizer.bound import BLEND_OPS, COLOUR_OPS, LANES, PROJECT_OPS, SKIN_OPS, bound_ms
from readygo.benchmarks.rasterizer.render import bench_render, speed
from readygo.benchmarks.rasterizer.runs import STAGES, Timing, make_backend, measure, measure_in_processes, stages_ms
from readygo.benchmarks.rasterizer.scenery import (
    TURN_RAD,
    gaussian_count,
    open_scenery,
    random_places,
    with_gaussian_count,
)
from readygo.benchmarks.rasterizer.setting import Job, Setting, open_setting
from readygo.commands import COMMANDS
from readygo.common.avatars import load_avatars, pose_avatar
from readygo.common.errors import ConfigError
from readygo.common.images.images import Images
from readygo.common.rasterizer.interface import View

JOB = Job(
    scene="",
    synthetic="3k",
    avatars=2,
    placement="free",
    avatar_folder=None,
    avatar_gaussians=1000,
    motion=None,
    height_px=48,
    width_px=64,
    frames=16,
    views=2,
    threads=1,
    backend="cpu",
    lod="off",
    seed=0,
)


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture
def setting() -> Setting:
    return open_setting(JOB)


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
    bench_render(synthetic="3k", avatar_gaussians="1k", size="48x64", frames=16, views=2)
    text = capsys.readouterr().out
    for word in ("images_per_s", *STAGES, "bound_images_per_s", "share_of_bound", "reference", "psnr_db"):
        assert word in text


def test_every_stage_is_called_by_an_image_with_people(setting: Setting) -> None:
    before = [getattr(module, name) for functions in STAGES.values() for module, name in functions]
    spent_ms = stages_ms(setting, make_backend(setting))
    assert all(ms > 0 for ms in spent_ms.values())
    assert before == [getattr(module, name) for functions in STAGES.values() for module, name in functions]


def test_without_a_gpu_no_number_is_made_up(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(render_run, "_has_gpu", lambda: False)
    bench_render(synthetic="3k", backend="gpu", json=True)
    result = json.loads(capsys.readouterr().out)
    assert result["images_per_s"] is None
    assert result["why_none"] == "no gpu"
    assert "images_per_s_wall" not in result
    bench_render(synthetic="3k", backend="gpu")
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
            bench_render(**{"synthetic": "3k", **options})
        assert "\n" not in str(caught.value)


def test_file_that_is_no_motion_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "walk.npz", root_m=np.zeros((3, 3), dtype=np.float32))
    with pytest.raises(ConfigError, match="no motion"):
        bench_render(synthetic="3k", motion=tmp_path / "walk.npz")


@pytest.mark.parametrize(("text", "count"), [("30000", 30_000), ("500k", 500_000), ("1.5M", 1_500_000), ("20M", 2e7)])
def test_numbers_of_gaussians_are_read_with_their_unit(text: str, count: float) -> None:
    assert gaussian_count(text) == count


def test_people_walk_and_the_camera_turns_with_every_image(setting: Setting) -> None:
    place = setting.places[0]
    first, second = setting.view(place, 0), setting.view(place, 1)
    assert np.arccos(first.T_world_camera[:3, 2] @ second.T_world_camera[:3, 2]) == pytest.approx(TURN_RAD, rel=1e-3)
    for before, after, point in zip(first.humans, second.humans, place.people_m, strict=True):
        assert before.root_m[:2] == pytest.approx(point[:2], abs=1e-5)
        assert 0.02 < np.linalg.norm(after.root_m - before.root_m) < 0.12
        assert not np.array_equal(before.pose_axis_angle, after.pose_axis_angle)


def test_people_stand_on_the_floor_in_sight_unless_any_place_will_do() -> None:
    scenery = open_scenery("", "3k", 0)
    occupancy = scenery.occupancy

    def blocked(in_sight: bool) -> int:
        places = random_places(scenery, 2, 30, 1, in_sight=in_sight)
        cells = [occupancy.frame.cell(x, y) for place in places for x, y, _ in place.people_m]
        rows, columns = occupancy.occupied.shape
        outside = [not (0 <= row < rows and 0 <= column < columns) for row, column in cells]
        return sum(out or bool(occupancy.occupied[cell]) for out, cell in zip(outside, cells, strict=True))

    assert blocked(in_sight=True) == 0
    assert blocked(in_sight=False) > 5


@pytest.mark.parametrize("count", [9000, 100_000])
def test_avatar_of_another_gaussian_count_keeps_its_shape(count: int) -> None:
    avatar = next(iter(load_avatars().values()))
    other = with_gaussian_count(avatar, count)
    assert len(other.cloud) == len(other.lbs_index) == len(other.lbs_weight) == count
    area = (avatar.cloud.scales_m**2).sum(), (other.cloud.scales_m**2).sum()
    assert area[1] == pytest.approx(area[0], rel=0.05)
    posed = [pose_avatar(a, np.zeros(3), np.zeros((24, 3))).means_m for a in (avatar, other)]
    np.testing.assert_allclose(np.quantile(posed[1], [0.1, 0.5, 0.9], axis=0),
                               np.quantile(posed[0], [0.1, 0.5, 0.9], axis=0), atol=0.01)  # fmt: skip


def test_processes_measure_the_same_number_of_images_each() -> None:
    timings = measure_in_processes(dataclasses.replace(JOB, threads=2, frames=4, views=1))
    assert [timing.cpu_s.shape for timing in timings] == [(4, 1, 1)] * 2
    assert all((timing.cpu_s > 0).all() for timing in timings)


def test_process_that_fails_ends_the_measurement_with_its_error() -> None:
    with pytest.raises(ConfigError, match="exclude each other"):
        measure_in_processes(dataclasses.replace(JOB, threads=1, scene="embedded"))


def test_only_images_after_the_first_of_a_view_are_timed(setting: Setting) -> None:
    drawn: list[View] = []

    class Recorder:
        views_at_once = 1

        def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
            drawn.extend(views)
            return Images(rgb=np.zeros((len(views), 1, 1, 3), dtype=np.uint8))

    timing = measure(setting, Recorder())
    assert timing.cpu_s.shape == timing.wall_s.shape == (4, 2, 2)
    # Two views for warming up, then per run and view one image that is not timed and two that are.
    assert len(drawn) == 2 + 4 * 2 * 3


def test_speed_takes_the_fastest_run_and_adds_processes_up() -> None:
    cpu_s = np.array([[[0.02, 0.04]], [[0.03, 0.02]]])
    one = speed([Timing(cpu_s=cpu_s, wall_s=2 * cpu_s)])
    assert one["images_per_s"] == pytest.approx(50.0)
    assert one["images_per_s_wall"] == pytest.approx(4 / 0.22)
    two = speed([Timing(cpu_s=cpu_s, wall_s=2 * cpu_s)] * 2)
    assert two["images_per_s"] == pytest.approx(100.0)
    assert two["ms_per_image"] == pytest.approx(20.0)
    assert two["images_per_s_per_core"]["median"] == pytest.approx(50.0)


def test_bound_follows_from_the_work_and_the_peak(setting: Setting) -> None:
    joints = np.mean([(avatar.lbs_weight > 0).sum(axis=1).mean() for avatar in setting.avatars])
    work = {"drawn": 1600.0, "drawn_people": 160.0, "block_entries": 1000.0}
    stages = bound_ms(work, setting, 16, 1e6)
    assert stages["blend"] == pytest.approx(1000 * BLEND_OPS / 1e3)
    assert stages["project_scene"] == pytest.approx(1440 / LANES * (PROJECT_OPS + COLOUR_OPS[16]) / 1e3)
    assert stages["pose_and_project_people"] == pytest.approx(160 / LANES * (PROJECT_OPS + SKIN_OPS * joints) / 1e3)


def test_slow_peer_is_left_out_of_large_scenes_and_says_so(setting: Setting) -> None:
    result = render._peers(setting, make_backend(setting), 20_000_000)
    assert "images_per_s" not in result["reference"]
    assert "Gaussians" in result["reference"]["why_none"]
