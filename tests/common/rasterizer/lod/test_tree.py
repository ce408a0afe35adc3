import itertools
from dataclasses import replace

import numpy as np
import pytest

from readygo.common.rasterizer.cpu.lod_cull import COARSENESS, Cut, cull_tree
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.cpu.view import VisibleChunks, make_view
from readygo.common.rasterizer.lod.tree import ChunkTree, _reach, build_tree, children_of
from readygo.common.rasterizer.packed.scene import PackedScene, pack_cloud
from tests.common.rasterizer.drawing import images_of, rgb_of
from tests.common.rasterizer.lod.lod_scenes import cut_at, leaves_of, psnr_db, room

H, W = 72, 128


@pytest.fixture(scope="module")
def scene() -> PackedScene:
    return pack_cloud(room(40000), normals=True)


@pytest.fixture(scope="module")
def tree(scene: PackedScene) -> ChunkTree:
    return build_tree(scene)


def gaussians_of(scene: PackedScene) -> np.ndarray:
    """Gaussians per chunk."""
    return (scene.geometry[:, :, -1] >= 0).sum(axis=(1, 2))


def test_every_cut_stands_for_every_gaussian_once(scene: PackedScene, tree: ChunkTree) -> None:
    leaves = leaves_of(tree)
    rng = np.random.default_rng(0)
    for share in (0.0, 0.1, 0.5, 0.9, 1.0):
        cut = list(cut_at(tree, rng.random(len(tree.skip)) < share))
        runs = [leaves[k] for k in cut]
        assert runs[0][0] == 0
        assert runs[-1][1] == scene.chunk_count
        assert all(before[1] == after[0] for before, after in itertools.pairwise(runs))


@pytest.mark.parametrize("coarseness", [0.0, 0.3, 1.0, 3.0, 1e9])
def test_what_a_view_of_everything_draws_is_such_a_cut(scene: PackedScene, tree: ChunkTree, coarseness: float) -> None:
    T = np.array([[0.0, 0.0, 1.0, -9.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.5], [0.0, 0.0, 0.0, 1.0]])
    view = make_view(T, np.array([[20.0, 0.0, 64.0], [0.0, 20.0, 36.0], [0.0, 0.0, 1.0]]), H, W)
    count = len(tree.skip)
    out = VisibleChunks(np.empty(count, np.int64), np.empty(count), np.empty(count, np.int64), np.empty((2, 3)))
    boxes = tree.scene.centre_m, tree.scene.half_m, tree.scene.reach_m
    seen = cull_tree(view, *boxes, Cut(tree.skip, tree.pixel_m, coarseness), out)
    leaves = leaves_of(tree)
    covered = [leaf for k in out.number[:seen] for leaf in range(*leaves[k])]
    assert covered == list(range(scene.chunk_count))
    assert coarseness > 0 or seen == scene.chunk_count
    assert coarseness < 1e9 or seen < 10


def test_leaves_are_the_chunks_of_the_cloud(scene: PackedScene, tree: ChunkTree) -> None:
    leaves = tree.skip == np.arange(len(tree.skip)) + 1
    for name in ("centre_m", "half_m", "reach_m", "geometry", "colour", "normal"):
        assert np.array_equal(getattr(tree.scene, name)[leaves], getattr(scene, name))
    assert (tree.pixel_m[leaves] == 0).all()


def test_nodes_are_for_larger_pixels_than_their_children_and_have_fewer_gaussians(tree: ChunkTree) -> None:
    count = gaussians_of(tree.scene)
    inner = [k for k in range(len(tree.skip)) if tree.skip[k] > k + 1]
    assert len(inner) > 20
    for k in inner:
        below = list(children_of(k, tree.skip))
        assert tree.pixel_m[k] > tree.pixel_m[below].max()
        assert 0 < count[k] <= 0.7 * count[below].sum()


def test_boxes_hold_those_of_the_nodes_below(tree: ChunkTree) -> None:
    low, high = tree.scene.centre_m - tree.scene.half_m, tree.scene.centre_m + tree.scene.half_m
    for k in range(len(tree.skip)):
        below = slice(k, int(tree.skip[k]))
        assert (low[below] >= low[k] - 1e-5).all()
        assert (high[below] <= high[k] + 1e-5).all()
        assert (tree.scene.reach_m[below] <= tree.scene.reach_m[k]).all()


def test_reach_holds_every_gaussian_to_its_faintest_part() -> None:
    rng = np.random.default_rng(6)
    for spread in ((1.0, 1.0, 1.0), (1.0, 0.02, 0.02), (0.3, 1.0, 0.01)):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        covariance = turn @ np.diag(np.square(spread)) @ turn.T
        row = np.zeros((2, 11))
        row[:, 3:9], row[:, 10] = covariance[np.triu_indices(3)], (7.0, 2.0)
        farthest_m = np.sqrt(7.0 * np.linalg.eigvalsh(covariance)[-1])
        assert farthest_m <= _reach(row) <= 1.0001 * 3**0.25 * farthest_m + 1e-9
        assert spread[1] > 0.5 or _reach(row) < 1.001 * farthest_m


def test_same_cloud_gives_the_same_tree(scene: PackedScene, tree: ChunkTree) -> None:
    again = build_tree(scene)
    assert np.array_equal(again.skip, tree.skip)
    for name in ("centre_m", "half_m", "reach_m", "geometry", "colour", "normal"):
        assert np.array_equal(getattr(again.scene, name), getattr(tree.scene, name))


def test_tree_without_coarse_nodes_has_the_bytes_of_the_exact_image(
    scene: PackedScene, tree: ChunkTree, camera
) -> None:
    T, K = camera(-3.0, 0.5, 0.2, W, H)
    exact = rgb_of(CpuRasterizer(scene, {}, K, H, W), T)
    fine = replace(tree, pixel_m=np.where(tree.pixel_m > 0, np.inf, 0.0))
    assert np.array_equal(rgb_of(CpuRasterizer(fine, {}, K, H, W), T), exact)


def test_images_are_alike_and_come_closer_with_less_coarseness(scene: PackedScene, tree: ChunkTree, camera) -> None:
    views = [camera(x, y, yaw, W, H)[0] for x, y, yaw in ((-3.0, 0.5, 0.2), (3.0, 2.0, 2.5), (0.0, 0.0, -1.5))]
    K = camera(0, 0, 0, W, H)[1]
    exact = CpuRasterizer(scene, {}, K, H, W)
    lowest_db, records = [], []
    for coarseness in (3.0, 1.2, 0.4):
        coarse = CpuRasterizer(replace(tree, pixel_m=tree.pixel_m * (COARSENESS / coarseness)), {}, K, H, W)
        lowest_db.append(min(psnr_db(rgb_of(exact, T), rgb_of(coarse, T)) for T in views))
        records.append(int(coarse._ws.counts[0]))
    rgb_of(exact, views[-1])
    assert lowest_db[0] < lowest_db[1] < lowest_db[2]
    assert lowest_db[1] > 38
    assert records[0] < records[1] < records[2]
    assert records[1] < 0.6 * exact._ws.counts[0]


@pytest.mark.parametrize("coefficients", [4, 16])
def test_spherical_harmonics_are_merged_too(camera, coefficients: int) -> None:
    scene = pack_cloud(room(15000, coefficients=coefficients))
    T, K = camera(-3.0, 0.5, 0.2, 48, 36)
    exact = rgb_of(CpuRasterizer(scene, {}, K, 36, 48), T)
    assert psnr_db(exact, rgb_of(CpuRasterizer(build_tree(scene), {}, K, 36, 48), T)) > 36


def test_other_images_come_from_a_tree_as_well(scene: PackedScene, tree: ChunkTree, camera) -> None:
    T, K = camera(-3.0, 0.5, 0.2, W, H)
    outputs = ("depth", "normal", "alpha")
    exact = images_of(CpuRasterizer(scene, {}, K, H, W), T, outputs=outputs)
    coarse = images_of(CpuRasterizer(tree, {}, K, H, W), T, outputs=outputs)
    assert np.quantile(np.abs(coarse.depth_m / exact.depth_m - 1), 0.95) < 0.03
    assert np.quantile((coarse.normal * exact.normal).sum(axis=2), 0.05) > 0.97
    assert np.quantile(np.abs(coarse.alpha - exact.alpha), 0.95) < 0.05


def test_far_away_a_whole_scene_is_a_handful_of_nodes(tree: ChunkTree) -> None:
    cut = list(cut_at(tree, tree.pixel_m <= 8.0))
    assert len(cut) <= 4


@pytest.mark.parametrize("count", [0, 1, 300])
def test_small_clouds_have_trees(make_cloud, camera, count: int) -> None:
    T, K = camera(-40.0, 0.0, 0.0, 40, 30)
    tree = build_tree(pack_cloud(make_cloud(count)))
    rgb_of(CpuRasterizer(tree, {}, K, 30, 40), T)


def test_tree_of_a_room_is_as_it_was(golden_figures) -> None:
    tree = build_tree(pack_cloud(room(5000, coefficients=4), normals=True))
    golden_figures("lod/nodes", tree.skip, tree.pixel_m, scale=0.1)
    golden_figures("lod/boxes", tree.scene.centre_m, tree.scene.half_m, tree.scene.reach_m)
    rows = tree.scene.geometry.transpose(0, 1, 3, 2).reshape(-1, tree.scene.geometry.shape[2])
    golden_figures("lod/geometry", np.clip(rows, -50.0, 50.0))
    golden_figures("lod/colours", tree.scene.sh.reshape(len(tree.skip), -1), scale=1e-3)
    golden_figures("lod/normals", tree.scene.normal.reshape(len(tree.skip), -1), scale=0.01)
