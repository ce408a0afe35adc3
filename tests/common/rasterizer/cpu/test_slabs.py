"""Slabs of depth of the CPU rasterizer."""

import numpy as np
import pytest

from readygo.common.gaussians import concatenate
from readygo.common.rasterizer.cpu import slabs as cpu_slabs
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.packed.scene import pack_cloud
from tests.common.rasterizer.drawing import float_rgb_of


def test_skipping_hidden_chunks_changes_the_image_by_less_than_a_colour_step(
    make_cloud, camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall = make_cloud(12000, low=(1.0, -4.0, -1.0), high=(1.3, 4.0, 4.0), scale_m=0.12)
    behind = make_cloud(20000, low=(2.0, -8.0, -1.0), high=(9.0, 8.0, 4.0))
    T, K = camera(-1.0, 0.0, 0.0, 96, 64)
    rasterizer = CpuRasterizer(pack_cloud(concatenate([wall, behind])), {}, K, 64, 96)
    fast = float_rgb_of(rasterizer, T)
    records = int(rasterizer._ws.counts[0])
    monkeypatch.setattr(cpu_slabs, "SLAB_SHARES", ())
    full = float_rgb_of(rasterizer, T)
    assert records < 0.7 * rasterizer._ws.counts[0]
    assert np.abs(fast - full).max() < 1e-3
