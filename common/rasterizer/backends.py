"""The rasterizers that can be chosen, made in one place from the same things."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import get_args

from readygo.common.avatars import Avatar
from readygo.common.avatars.file import avatar_hash
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.backend_names import Backend
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.gpu.availability import require_kernels
from readygo.common.rasterizer.interface import PinholeCamera, Rasterizer
from readygo.common.rasterizer.lod.avatar import AvatarTree
from readygo.common.rasterizer.lod.files import load_or_build_avatar_tree, load_or_build_tree, load_or_pack_avatar
from readygo.common.rasterizer.lod.tree import ChunkTree
from readygo.common.rasterizer.packed.avatar import PackedAvatar
from readygo.common.rasterizer.packed.cache import is_being_made
from readygo.common.rasterizer.packed.scene import PackedScene, load_or_pack
from readygo.common.rasterizer.reference import ReferenceRasterizer
from readygo.common.rasterizer.warm import warm


@dataclass(frozen=True, kw_only=True, eq=False)
class StaticCloud:
    """A cloud that does not move, such as a scene or its sky."""

    key: str
    """Names its packed form in the cache; carries the hash of its contents."""
    load: Callable[[], GaussianCloud]
    """Loads it; not called where a packed form is in the cache."""


def make_rasterizer(
    backend: str,
    clouds: Sequence[StaticCloud],
    avatars: Mapping[str, Avatar],
    camera: PinholeCamera,
    *,
    cache: Path,
    avatar_cache: Path | None = None,
    outputs: Sequence[str] = ("rgb",),
    detail: str = "exact",
) -> Rasterizer:
    """A rasterizer, ready to draw.

    Args:
        backend: One of `Backend`.
        clouds: What stands still.
        avatars: Who may be drawn, by name.
        camera: The camera.
        cache: Folder of the backend cpu for packed clouds; where it cannot be written, they stay in memory.
        avatar_cache: The same for packed avatars; None for that of the clouds.
        outputs: Images that will be asked for, out of `readygo.common.images.images.OUTPUTS`.
        detail: "exact", or "lod" for levels of detail (backend cpu).

    Raises:
        ValueError: If the backend is unknown, or has no levels of detail.
        ReadygoError: If a GPU or a package is missing.
    """
    if backend not in get_args(Backend):
        raise ValueError(f"backend must be one of {', '.join(get_args(Backend))}, got {backend!r}.")
    if detail != "exact" and backend != "cpu":
        raise ValueError(f"detail {detail!r} is drawn by the backend cpu only, got {backend!r}.")
    if backend == "cpu":
        return _make_cpu(clouds, avatars, camera, (cache, avatar_cache or cache), outputs, detail)
    if backend == "reference":
        return ReferenceRasterizer([cloud.load() for cloud in clouds], avatars, camera)
    return _make_gpu(backend, clouds, avatars, camera)


def packed_cloud(cloud: StaticCloud, cache: Path, *, normals: bool = False) -> PackedScene:
    """A cloud packed for the backend cpu, in the cache folder; the first process that needs it packs it."""
    return load_or_pack(cache / f"packed-{cloud.key}", cloud.load, normals=normals)


def cloud_tree(cloud: StaticCloud, cache: Path, *, normals: bool = False) -> ChunkTree:
    """A cloud as a tree with levels of detail, cached; the first process takes about 30 s per million Gaussians."""
    pack = partial(packed_cloud, cloud, cache, normals=normals)
    return load_or_build_tree(cache / f"lod-{cloud.key}", pack, normals=normals)


def packed_avatars(
    avatars: Mapping[str, Avatar], cache: Path, *, detail: str = "exact"
) -> dict[str, PackedAvatar | AvatarTree]:
    """Packed avatars from the cache folder, in order; with levels of detail if `detail` is "lod".

    Those that another process is packing come last: processes that begin together share the work.
    """
    pack = load_or_build_avatar_tree if detail == "lod" else load_or_pack_avatar
    folders = {name: cache / f"avatar-{avatar_hash(avatar)[:16]}-{detail}" for name, avatar in avatars.items()}
    packed: dict[str, PackedAvatar | AvatarTree] = {}
    for waits in (False, True):
        for name, folder in folders.items():
            if name not in packed and (waits or not is_being_made(folder)):
                packed[name] = pack(folder, avatars[name])
    return {name: packed[name] for name in avatars}


def _make_cpu(
    clouds: Sequence[StaticCloud],
    avatars: Mapping[str, Avatar],
    camera: PinholeCamera,
    caches: tuple[Path, Path],
    outputs: Sequence[str],
    detail: str,
) -> Rasterizer:
    """The rasterizer of the backend cpu; `caches` are the folders of clouds and of avatars."""
    warm(outputs)
    cache, avatar_cache = caches
    make = packed_cloud if detail == "exact" else cloud_tree
    return CpuRasterizer(
        [make(cloud, cache, normals="normal" in outputs) for cloud in clouds],
        {name: avatar.skeleton() for name, avatar in avatars.items()},
        camera.K_px,
        camera.height_px,
        camera.width_px,
        packed_avatars=packed_avatars(avatars, avatar_cache, detail=detail),
    )


def _make_gpu(
    backend: str, clouds: Sequence[StaticCloud], avatars: Mapping[str, Avatar], camera: PinholeCamera
) -> Rasterizer:
    require_kernels(backend, "cuda")
    # torch takes seconds to load; this module does not.
    from readygo.common.rasterizer.gpu.rasterizer import GpuRasterizer

    loaded, size = [cloud.load() for cloud in clouds], (camera.height_px, camera.width_px)
    return GpuRasterizer(loaded, avatars, camera.K_px, *size, kernels=backend)
