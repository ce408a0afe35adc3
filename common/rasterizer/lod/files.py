"""Cache folders of trees of chunks and of packed avatars: read-only memory maps that all workers of a host share.

A folder's name carries the content hash of what it was made from; the first process makes it while others wait.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from readygo.common.arrays import AnyArray
from readygo.common.avatars import Avatar
from readygo.common.documents import read_json
from readygo.common.errors import SceneError
from readygo.common.files import unfinished_folder
from readygo.common.rasterizer.lod.avatar import AvatarTree, build_avatar_tree
from readygo.common.rasterizer.lod.tree import ChunkTree, build_tree
from readygo.common.rasterizer.packed.avatar import JOINTS, PackedAvatar, pack_avatar
from readygo.common.rasterizer.packed.cache import load_or_make
from readygo.common.rasterizer.packed.scene import BLOCKS, PackedScene, load_packed, map_array, save_packed

Arrays = dict[str, AnyArray]

FORMAT = "readygo-lod/1"
_TREE_ARRAYS = ("skip", "pixel_m")
_AVATAR_ARRAYS = ("joint_start", "joint", "weight", "box_start", "box_joint", "box_centre_m", "box_half_m")


def load_or_build_tree(folder: str | Path, scene: Callable[[], PackedScene], *, normals: bool = False) -> ChunkTree:
    """The tree in `folder`; built above `scene()` and written there if it is missing or damaged.

    Args:
        folder: Cache folder of one cloud; its name carries the cloud's content hash.
        scene: Packs the cloud, with normals if they are wanted; not called when the cache is good.
        normals: The tree shall have normals.

    Returns:
        Read-only memory maps, or the tree itself where the folder cannot be written.
    """

    def load() -> ChunkTree | None:
        tree = load_tree(Path(folder))
        return None if tree is None or (normals and tree.scene.normal is None) else tree

    return load_or_make(Path(folder), load, lambda: build_tree(scene()), save_tree)


def load_or_build_avatar_tree(folder: str | Path, avatar: Avatar) -> AvatarTree:
    """An avatar's tree in `folder`, whose name carries the avatar's hash; see `load_or_build_tree`."""
    path = Path(folder)
    return load_or_make(
        path, lambda: load_avatar_tree(path), lambda: build_avatar_tree(pack_avatar(avatar)), save_avatar_tree
    )


def load_or_pack_avatar(folder: str | Path, avatar: Avatar) -> PackedAvatar:
    """A packed avatar in `folder`, whose name carries the avatar's hash; see `load_or_build_tree`."""
    path = Path(folder)
    return load_or_make(path, lambda: load_packed_avatar(path), lambda: pack_avatar(avatar), save_packed_avatar)


def save_tree(tree: ChunkTree, folder: Path) -> None:
    """Write a tree to `folder`, which appears complete or not at all; one that is there is replaced."""
    _save(folder, tree.scene, _arrays_of(tree, _TREE_ARRAYS))


def load_tree(folder: Path) -> ChunkTree | None:
    """Map a tree read-only; None if the folder holds no valid one."""
    loaded = _load(folder, _TREE_ARRAYS)
    if loaded is None or not _is_tree(*loaded):
        return None
    return ChunkTree(scene=loaded[0], skip=loaded[1]["skip"], pixel_m=loaded[1]["pixel_m"])


def save_avatar_tree(tree: AvatarTree, folder: Path) -> None:
    """Write an avatar's tree; see `save_tree`."""
    arrays = _arrays_of(tree, _TREE_ARRAYS) | _arrays_of(tree.avatar, _AVATAR_ARRAYS)
    _save(folder, tree.avatar.scene, arrays)


def load_avatar_tree(folder: Path) -> AvatarTree | None:
    """Map an avatar's tree read-only; None if the folder holds no valid one."""
    loaded = _load(folder, (*_TREE_ARRAYS, *_AVATAR_ARRAYS))
    if loaded is None or not _is_tree(*loaded) or not _is_avatar(*loaded):
        return None
    scene, arrays = loaded
    avatar = PackedAvatar(scene=scene, **{name: arrays[name] for name in _AVATAR_ARRAYS})
    return AvatarTree(avatar=avatar, skip=arrays["skip"], pixel_m=arrays["pixel_m"])


def save_packed_avatar(avatar: PackedAvatar, folder: Path) -> None:
    """Write a packed avatar; see `save_tree`."""
    _save(folder, avatar.scene, _arrays_of(avatar, _AVATAR_ARRAYS))


def load_packed_avatar(folder: Path) -> PackedAvatar | None:
    """Map a packed avatar read-only; None if the folder holds no valid one."""
    loaded = _load(folder, _AVATAR_ARRAYS)
    if loaded is None or not _is_avatar(*loaded):
        return None
    return PackedAvatar(scene=loaded[0], **loaded[1])


def _arrays_of(owner: object, names: tuple[str, ...]) -> Arrays:
    return {name: getattr(owner, name) for name in names}


def _save(folder: Path, scene: PackedScene, arrays: Arrays) -> None:
    with unfinished_folder(folder, good=lambda: False, raises=OSError) as part:
        save_packed(scene, part / "chunks")
        for name, array in arrays.items():
            np.save(part / f"{name}.npy", array)
        (part / "lod.json").write_text(json.dumps({"format": FORMAT}))


def _load(folder: Path, names: tuple[str, ...]) -> tuple[PackedScene, Arrays] | None:
    try:
        if read_json(folder / "lod.json") != {"format": FORMAT}:
            return None
        scene = load_packed(folder / "chunks")
        arrays = {name: map_array(folder / f"{name}.npy") for name in names}
    except (OSError, ValueError, SceneError):
        return None
    return None if scene is None else (scene, arrays)


def _is_tree(scene: PackedScene, arrays: Arrays) -> bool:
    """True if kernels can walk the tree without leaving its arrays."""
    skip, chunks = arrays["skip"], scene.chunk_count
    if skip.shape != (chunks,) or arrays["pixel_m"].shape != (chunks,):
        return False
    return bool((skip > np.arange(chunks)).all() and (skip <= chunks).all())


def _is_avatar(scene: PackedScene, arrays: Arrays) -> bool:
    """True if kernels can pose and light the avatar without leaving its arrays."""
    blocks, joints, boxes = scene.chunk_count * BLOCKS, len(arrays["joint"]), len(arrays["box_joint"])
    shapes = {"weight": (joints, 16), "box_centre_m": (boxes, 3), "box_half_m": (boxes, 3)}
    return (
        scene.normal is not None
        and all(arrays[name].shape == shape for name, shape in shapes.items())
        and _is_index(arrays["joint_start"], blocks, joints)
        and _is_index(arrays["box_start"], scene.chunk_count, boxes)
        and all(bool(((arrays[name] >= 0) & (arrays[name] < JOINTS)).all()) for name in ("joint", "box_joint"))
    )


def _is_index(start: AnyArray, count: int, end: int) -> bool:
    """True if `start` divides 0..end into `count` runs."""
    return (
        start.shape == (count + 1,)
        and int(start[0]) == 0
        and int(start[-1]) == end
        and bool((np.diff(start) >= 0).all())
    )
