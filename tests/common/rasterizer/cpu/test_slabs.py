"""Slabs of depth of the CPU rasterizer."""

import numpy as np
import pytest

from readygo.common.gaussians import concatenate
from readygo.common.rasterizer.cpu import slabs as cpu_slabs
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.cpu.slabs import (
    FAR_BITS,
    NEAR_BITS,
    SLAB_MIN_CHUNKS,
    SLAB_SHARES,
    Slab,
    is_due,
    slabs_of,
)
from readygo.common.rasterizer.cpu.tiles import pack_box
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


def test_few_chunks_are_one_slab() -> None:
    (slab,) = slabs_of(np.linspace(1.0, 9.0, SLAB_MIN_CHUNKS))
    assert (slab.first_m, slab.limit_m, slab.limit_bits, slab.cull) == (-np.inf, np.inf, FAR_BITS, False)


def test_slabs_follow_each_other_and_end_at_shares_of_the_chunks() -> None:
    depths_m = np.random.default_rng(0).permutation(np.linspace(1.0, 9.0, 1000))
    slabs = slabs_of(depths_m)
    assert [slab.limit_m for slab in slabs[:-1]] == [np.sort(depths_m)[int(share * 1000)] for share in SLAB_SHARES]
    assert [slab.first_m for slab in slabs[1:]] == [slab.limit_m for slab in slabs[:-1]]
    assert [slab.cull for slab in slabs] == [False] + [True] * len(SLAB_SHARES)
    for slab in slabs[:-1]:
        assert np.int32(slab.limit_bits + NEAR_BITS).view(np.float32) == np.float32(slab.limit_m)


def test_no_slab_ends_before_the_near_plane() -> None:
    depths_m = np.concatenate([np.full(500, -1.0), np.linspace(1.0, 2.0, 500)])
    assert all(slab.limit_m >= 1.0 for slab in slabs_of(depths_m))


def test_chunk_is_due_in_its_slab_where_pixels_are_not_finished() -> None:
    alive, box = np.zeros(8, np.int64), pack_box(0, 3, 0, 3)
    free, culling = Slab(-np.inf, 2.0, 0, False), Slab(2.0, 4.0, 0, True)
    assert [bool(is_due(free, depth_m, box, 2, alive)) for depth_m in (-5.0, 1.9, 2.0)] == [True, True, False]
    assert not is_due(culling, 3.0, box, 2, alive)
    alive[0] = 1
    assert [bool(is_due(culling, depth_m, box, 2, alive)) for depth_m in (1.9, 2.0, 4.0)] == [False, True, False]
