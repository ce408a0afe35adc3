from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.rasterizer.lod import files as lod_files
from readygo.common.rasterizer.lod.files import (
    load_or_build_avatar_tree,
    load_or_build_tree,
    load_or_pack_avatar,
    load_tree,
)
from readygo.common.rasterizer.lod.tree import ChunkTree, build_tree
from readygo.common.rasterizer.packed.avatar import PackedAvatar, pack_avatar
from readygo.common.rasterizer.packed.scene import PackedScene, pack_cloud


@pytest.fixture(scope="module")
def scene(make_cloud) -> PackedScene:
    return pack_cloud(make_cloud(1500))


def same(a: ChunkTree, b: ChunkTree) -> bool:
    arrays = ("centre_m", "half_m", "reach_m", "geometry", "colour")
    return np.array_equal(a.skip, b.skip) and all(
        np.array_equal(getattr(a.scene, name), getattr(b.scene, name)) for name in arrays
    )


def unwanted() -> PackedScene:
    raise AssertionError("the scene was packed")


def test_tree_comes_back_as_read_only_maps_without_the_scene(scene: PackedScene, tmp_path: Path) -> None:
    first = load_or_build_tree(tmp_path / "cache" / "lod", lambda: scene)
    again = load_or_build_tree(tmp_path / "cache" / "lod", unwanted)
    assert same(first, again)
    for array in (again.scene.geometry, again.skip, again.pixel_m):
        assert isinstance(array, np.memmap)
        assert not array.flags.writeable


def test_another_hash_is_another_tree(scene: PackedScene, make_cloud, tmp_path: Path) -> None:
    first = load_or_build_tree(tmp_path / "lod-a", lambda: scene)
    other = load_or_build_tree(tmp_path / "lod-b", lambda: pack_cloud(make_cloud(1500, seed=1)))
    assert not same(first, other)
    assert same(first, load_or_build_tree(tmp_path / "lod-a", unwanted))


@pytest.mark.parametrize("damage", ["truncate", "remove", "format", "mismatch", "loop", "chunks"])
def test_damaged_cache_is_made_anew(scene: PackedScene, tmp_path: Path, damage: str) -> None:
    folder = tmp_path / "lod"
    good = build_tree(scene)
    load_or_build_tree(folder, lambda: scene)
    skip = good.skip.copy()
    if damage == "truncate":
        (folder / "skip.npy").write_bytes((folder / "skip.npy").read_bytes()[:140])
    elif damage == "remove":
        (folder / "pixel_m.npy").unlink()
    elif damage == "format":
        (folder / "lod.json").write_text('{"format": "readygo-lod/0"}')
    elif damage == "mismatch":
        np.save(folder / "pixel_m.npy", np.zeros(1))
    elif damage == "loop":
        skip[-1] = 0
        np.save(folder / "skip.npy", skip)
    else:
        (folder / "chunks" / "geometry.npy").unlink()
    assert load_tree(folder) is None
    assert same(good, load_or_build_tree(folder, lambda: scene))
    assert load_tree(folder) is not None


def test_normals_are_added_to_a_tree_without(make_cloud, tmp_path: Path) -> None:
    cloud = make_cloud(300)
    assert load_or_build_tree(tmp_path / "lod", lambda: pack_cloud(cloud)).scene.normal is None
    tree = load_or_build_tree(tmp_path / "lod", lambda: pack_cloud(cloud, normals=True), normals=True)
    assert tree.scene.normal is not None
    assert load_or_build_tree(tmp_path / "lod", unwanted, normals=True).scene.normal is not None


def test_folder_that_cannot_be_written_gives_an_unmapped_tree(scene: PackedScene, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    tree = load_or_build_tree(tmp_path / "file" / "lod", lambda: scene)
    assert not isinstance(tree.scene.geometry, np.memmap)


def test_packed_avatar_comes_back_as_it_was(avatar: Avatar, tmp_path: Path) -> None:
    fresh = pack_avatar(avatar)
    load_or_pack_avatar(tmp_path / "avatar", avatar)
    mapped = load_or_pack_avatar(tmp_path / "avatar", avatar)
    assert isinstance(mapped.scene.geometry, np.memmap)
    assert np.array_equal(mapped.scene.geometry, fresh.scene.geometry)
    for name in ("joint_start", "joint", "weight", "box_start", "box_joint", "box_centre_m", "box_half_m"):
        assert np.array_equal(getattr(mapped, name), getattr(fresh, name))


@pytest.mark.parametrize("name", ["joint", "joint_start", "box_start", "box_joint"])
def test_avatar_whose_indices_lead_out_of_its_arrays_is_made_anew(avatar: Avatar, tmp_path: Path, name: str) -> None:
    folder = tmp_path / "avatar"
    good = np.array(getattr(load_or_build_avatar_tree(folder, avatar).avatar, name))
    broken = good.copy()
    broken[len(broken) // 2] = 10**6
    np.save(folder / f"{name}.npy", broken)
    assert lod_files.load_avatar_tree(folder) is None
    assert np.array_equal(getattr(load_or_build_avatar_tree(folder, avatar).avatar, name), good)


@pytest.mark.parametrize("damage", ["remove", "truncate"])
def test_avatar_that_lost_its_normals_is_made_anew(avatar: Avatar, tmp_path: Path, damage: str) -> None:
    for folder, load_or_make in (
        (tmp_path / "exact", load_or_pack_avatar),
        (tmp_path / "lod", load_or_build_avatar_tree),
    ):
        load_or_make(folder, avatar)
        path = folder / "chunks" / "normal.npy"
        path.unlink() if damage == "remove" else path.write_bytes(path.read_bytes()[:200])
        made = load_or_make(folder, avatar)
        packed = made if isinstance(made, PackedAvatar) else made.avatar
        assert np.array_equal(packed.scene.normal, np.load(path))
