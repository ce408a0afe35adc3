import re
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.packed import scene as packing
from readygo.common.rasterizer.packed.scene import (
    CHUNK,
    PackedScene,
    load_or_pack,
    load_packed,
    morton_codes,
    pack_cloud,
    pack_sorted,
    save_packed,
)
from tests.common.rasterizer.cpu.frames_digest import cloud as noise

ARRAYS = ("centre_m", "half_m", "reach_m", "geometry", "colour", "sh", "sh_step")


def same(a: PackedScene, b: PackedScene) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ARRAYS)


def means_of(scene: PackedScene) -> np.ndarray:
    return scene.geometry[:, :, :3].transpose(0, 1, 3, 2).reshape(-1, CHUNK, 3) + scene.centre_m[:, None]


def test_every_visible_gaussian_is_packed_once(make_cloud) -> None:
    cloud = make_cloud(1000)
    scene = pack_cloud(cloud)
    visible = cloud.opacities >= np.float32(1 / 255)
    drawn = (scene.geometry[:, :, 10] >= 0).reshape(-1)
    assert drawn.sum() == visible.sum() < 1000
    packed = np.sort(means_of(scene).reshape(-1, 3)[drawn], axis=0)
    assert np.allclose(packed, np.sort(cloud.means_m[visible], axis=0), atol=1e-6)


def test_boxes_hold_their_means(make_cloud) -> None:
    scene = pack_cloud(make_cloud(3000))
    drawn = (scene.geometry[:, :, 10] >= 0).reshape(-1, CHUNK)
    offset = np.abs(means_of(scene) - scene.centre_m[:, None])
    assert (offset <= scene.half_m[:, None] + 1e-6)[drawn].all()


def test_order_of_the_cloud_does_not_matter(make_cloud) -> None:
    cloud = make_cloud(2000)
    assert same(pack_cloud(cloud), pack_cloud(cloud.select(np.random.default_rng(3).permutation(2000))))


def test_neighbours_on_the_curve_are_neighbours_in_space(make_cloud) -> None:
    means = make_cloud(5000).means_m
    ordered = means[np.argsort(morton_codes(means))]
    steps_m = [np.linalg.norm(np.diff(points, axis=0), axis=1).mean() for points in (ordered, means)]
    assert steps_m[0] < 0.2 * steps_m[1]


@pytest.mark.parametrize("coefficients", [4, 9, 16])
def test_spherical_harmonics_keep_four_digits(make_cloud, coefficients: int) -> None:
    cloud = make_cloud(600, coefficients=coefficients)
    scene = pack_sorted(cloud)
    values = scene.sh.transpose(0, 1, 4, 3, 2).reshape(-1, coefficients, 3)[:600] * scene.sh_step
    assert np.abs(values - cloud.sh).max() < 1e-4
    assert scene.colour.shape[0] == 0


def test_empty_cloud_can_be_packed_and_stored(make_cloud, tmp_path: Path) -> None:
    save_packed(pack_cloud(make_cloud(0)), tmp_path / "packed")
    loaded = load_packed(tmp_path / "packed")
    assert loaded is not None
    assert loaded.chunk_count == 0


@pytest.mark.parametrize("coefficients", [1, 4])
def test_stored_scene_comes_back_as_a_read_only_map(make_cloud, tmp_path: Path, coefficients: int) -> None:
    scene = pack_cloud(make_cloud(700, coefficients=coefficients))
    save_packed(scene, tmp_path / "packed")
    loaded = load_packed(tmp_path / "packed")
    assert loaded is not None
    assert same(scene, loaded)
    assert isinstance(loaded.geometry, np.memmap)
    assert not loaded.geometry.flags.writeable
    assert [path.name for path in tmp_path.iterdir()] == ["packed"]


def _resident_bytes(path: Path) -> int:
    """What this process has of its maps of a file."""
    maps = Path("/proc/self/smaps").read_text().split(str(path))[1:]
    return sum(1024 * int(found.group(1)) for each in maps if (found := re.search(r"\nRss:\s+(\d+) kB", each)))


@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="needs Linux's list of a process's memory")
@pytest.mark.parametrize(("limit_bytes", "share"), [(1 << 28, 1.0), (1 << 10, 0.2)])
def test_pages_of_a_map_are_there_before_they_are_looked_at_unless_it_is_large(
    limit_bytes: int, share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packing, "POPULATED_BYTES_MAX", limit_bytes)
    path = tmp_path / "array.npy"
    np.save(path, np.zeros(1 << 20, dtype=np.float32))
    array = packing.map_array(path)
    assert array.nbytes == 1 << 22
    resident = _resident_bytes(path) / array.nbytes
    assert resident >= share if share == 1.0 else resident <= share


def test_good_cache_is_used_without_the_cloud(make_cloud, tmp_path: Path) -> None:
    cloud = make_cloud(300)
    first = load_or_pack(tmp_path / "packed", lambda: cloud)

    def unwanted() -> GaussianCloud:
        raise AssertionError("the cloud was loaded")

    assert same(first, load_or_pack(tmp_path / "packed", unwanted))


def test_one_process_packs_while_others_wait_and_load_what_it_packed(make_cloud, tmp_path: Path) -> None:
    cloud, loads, started = make_cloud(300), [], threading.Event()

    def load() -> GaussianCloud:
        loads.append(1)
        started.set()
        # Time for the other one to find no pack either.
        time.sleep(0.2)
        return cloud

    packs: list[PackedScene] = []
    threads = [
        threading.Thread(target=lambda: packs.append(load_or_pack(tmp_path / "packed", load, normals=True)))
        for _ in range(2)
    ]
    threads[0].start()
    started.wait()
    threads[1].start()
    for thread in threads:
        thread.join()
    assert loads == [1]
    assert all(isinstance(pack.normal, np.memmap) and same(pack, packs[0]) for pack in packs)


@pytest.mark.parametrize("damage", ["truncate", "remove", "format", "mismatch"])
def test_damaged_cache_is_made_anew(make_cloud, tmp_path: Path, damage: str) -> None:
    cloud = make_cloud(300)
    folder = tmp_path / "packed"
    good = pack_cloud(cloud)
    save_packed(good, folder)
    if damage == "truncate":
        (folder / "geometry.npy").write_bytes((folder / "geometry.npy").read_bytes()[:1000])
    elif damage == "remove":
        (folder / "half_m.npy").unlink()
    elif damage == "format":
        (folder / "packed.json").write_text('{"format": "readygo-packed/0"}')
    else:
        np.save(folder / "centre_m.npy", np.zeros((9, 3)))
    assert load_packed(folder) is None
    assert same(good, load_or_pack(folder, lambda: cloud))
    assert load_packed(folder) is not None


def test_folder_that_cannot_be_written_gives_an_unmapped_pack(make_cloud, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    cloud = make_cloud(300)
    assert same(pack_cloud(cloud), load_or_pack(tmp_path / "file" / "packed", lambda: cloud))


def test_normals_are_added_to_a_pack_that_has_none(make_cloud, tmp_path: Path) -> None:
    cloud = make_cloud(700)
    plain = load_or_pack(tmp_path / "packed", lambda: cloud)
    with_normals = load_or_pack(tmp_path / "packed", lambda: cloud, normals=True)
    expected = pack_cloud(cloud, normals=True)
    assert plain.normal is None
    assert same(plain, with_normals)
    assert isinstance(with_normals.normal, np.memmap)
    assert np.array_equal(with_normals.normal, expected.normal)
    save_packed(expected, tmp_path / "at once")
    assert np.array_equal(load_packed(tmp_path / "at once").normal, expected.normal)
    assert sorted(path.name for path in (tmp_path / "packed").iterdir()) == sorted(
        path.name for path in (tmp_path / "at once").iterdir()
    )

    def unwanted() -> GaussianCloud:
        raise AssertionError("the cloud was loaded")

    again = load_or_pack(tmp_path / "packed", unwanted, normals=True)
    assert np.array_equal(again.normal, expected.normal)


def test_damaged_normals_are_made_anew_and_harm_nothing_else(make_cloud, tmp_path: Path) -> None:
    cloud = make_cloud(300)
    good = load_or_pack(tmp_path / "packed", lambda: cloud, normals=True)
    expected = np.array(good.normal)
    path = tmp_path / "packed" / "normal.npy"
    path.write_bytes(path.read_bytes()[:500])
    assert load_packed(tmp_path / "packed").normal is None
    assert np.array_equal(load_or_pack(tmp_path / "packed", lambda: cloud, normals=True).normal, expected)


def test_normals_in_a_folder_that_cannot_be_written_stay_in_memory(make_cloud, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    cloud = make_cloud(300)
    packed = load_or_pack(tmp_path / "file" / "packed", lambda: cloud, normals=True)
    assert np.array_equal(packed.normal, pack_cloud(cloud, normals=True).normal)


def test_packed_normals_are_the_unit_axes_with_the_smallest_scale(make_cloud) -> None:
    cloud = make_cloud(40)
    order = np.argsort(cloud.scales_m, axis=1)
    packed = pack_sorted(cloud, normals=True)
    normals = packed.normal.transpose(0, 1, 3, 2).reshape(-1, 3)[:40] / 32767
    axes = matrix_from_quat(cloud.quats_wxyz)
    for rank, cosine in ((0, 1.0), (1, 0.0), (2, 0.0)):
        axis = axes[np.arange(40), :, order[:, rank]]
        assert (normals * axis).sum(axis=1) == pytest.approx(np.full(40, cosine), abs=1e-4)


def test_packed_arrays_are_as_they_were(golden_figures) -> None:
    for coefficients in (1, 9):
        scene = pack_cloud(noise(700, coefficients, 4.0), normals=True)
        boxes = scene.centre_m, scene.half_m, scene.reach_m
        golden_figures(f"rasterizer/packed boxes {coefficients}", *boxes)
        rows = scene.geometry.transpose(0, 1, 3, 2).reshape(-1, scene.geometry.shape[2])
        golden_figures(f"rasterizer/packed geometry {coefficients}", np.clip(rows, -50, 50))
        for name in ("colour", "sh", "normal"):
            array = getattr(scene, name)
            if array is not None and len(array):
                golden_figures(f"rasterizer/packed {name} {coefficients}", array.reshape(len(array), -1), scale=0.01)
