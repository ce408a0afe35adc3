"""Which chunks a camera sees."""

import numpy as np

from readygo.common.avatars import Avatar
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.packed.scene import pack_cloud
from tests.common.rasterizer.drawing import human, numbered, rgb_of


def test_humans_outside_of_the_view_change_nothing(make_cloud, camera, avatar: Avatar) -> None:
    T, K = camera(0.0, 0.0, 0.0, 96, 64)
    rasterizer = CpuRasterizer(pack_cloud(make_cloud(900)), numbered([avatar]), K, 64, 96)
    alone = rgb_of(rasterizer, T)
    assert np.array_equal(alone, rgb_of(rasterizer, T, [human(-3.0, 0.0), human(1.0, 9.0)]))
