from pathlib import Path

import numpy as np
import pytest

from readygo.benchmarks.rasterizer.render import BenchAvatarOptions, BenchRenderOptions, bench_render
from readygo.benchmarks.rasterizer.scenery import (
    gaussian_count,
    open_scenery,
    random_places,
    synthetic_scenery,
    with_gaussian_count,
)
from readygo.benchmarks.rasterizer.synthetic_room import room_cloud
from readygo.common.avatars import load_avatars, pose_avatar
from readygo.common.errors import ConfigError
from readygo.common.robot import CameraConfig


def test_file_that_is_no_motion_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "walk.npz", root_m=np.zeros((3, 3), dtype=np.float32))
    with pytest.raises(ConfigError, match="no motion"):
        bench_render(BenchRenderOptions(synthetic="3k", pedestrians=BenchAvatarOptions(motion=tmp_path / "walk.npz")))


@pytest.mark.parametrize(("text", "count"), [("30000", 30_000), ("500k", 500_000), ("1.5M", 1_500_000), ("20M", 2e7)])
def test_numbers_of_gaussians_are_read_with_their_unit(text: str, count: float) -> None:
    assert gaussian_count(text) == count


def test_humans_stand_on_the_floor_in_sight_unless_any_place_will_do() -> None:
    scenery = open_scenery("", "3k", 0)
    occupancy = scenery.occupancy

    def blocked(in_sight: bool) -> int:
        places = random_places(scenery, 2, 30, 1, in_sight=in_sight)
        cells = [occupancy.frame.cell(x, y) for place in places for x, y, _ in place.humans_m]
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


def test_cameras_and_humans_stand_in_free_space(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    means = room_cloud(50_000).means_m
    for place in random_places(synthetic_scenery(50_000, 0), 2, 20, 0):
        eye = place.T_world_camera(CameraConfig(), 0)[:3, 3]
        for point in (eye, *(np.array([x, y, z + 1.0]) for x, y, z in place.humans_m)):
            assert np.linalg.norm(means - point, axis=1).min() > 0.15
