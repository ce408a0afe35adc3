"""Compile the CPU rasterizer's kernels before they are needed."""

import fcntl
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from readygo.common.avatars import Avatar
from readygo.common.files import make_cache_folder
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.cpu.project import project_scene
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman, View
from readygo.common.rasterizer.lod.avatar import AvatarTree
from readygo.common.rasterizer.lod.tree import ChunkTree
from readygo.common.rasterizer.packed.avatar import pack_avatar
from readygo.common.rasterizer.packed.scene import pack_cloud


def warm(outputs: Sequence[str] = ("rgb",)) -> None:
    """Compile the kernels, or load what is kept of them.

    Processes that do this at the same time wait for the first one and then load what it compiled.

    Args:
        outputs: Images that will be asked for, see `Rasterizer.render`.

    Raises:
        ReadygoError: If there is no folder for what is compiled.
    """
    folder = make_cache_folder(Path(project_scene._cache.cache_path))
    with (folder / "rasterizer.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        _draw_something(outputs)


def _draw_something(outputs: Sequence[str]) -> None:
    """Call every kernel once, with the argument types of every later call."""
    cloud = GaussianCloud(
        means_m=np.array([[0.0, 0.0, 2.0]], dtype=np.float32),
        quats_wxyz=np.array([[1.0, 0.0, 0.0, 0.0]], dtype=np.float32),
        scales_m=np.full((1, 3), 0.1, dtype=np.float32),
        opacities=np.array([0.5], dtype=np.float32),
        sh=np.zeros((1, 1, 3), dtype=np.float32),
    )
    avatar = Avatar(
        name="warm",
        license="",
        height_m=1.0,
        cloud=cloud,
        lbs_index=np.zeros((1, 4), dtype=np.uint8),
        lbs_weight=np.array([[1.0, 0.0, 0.0, 0.0]], dtype=np.float32),
        joints_canonical_m=np.zeros((24, 3), dtype=np.float32),
        joints_tpose_m=np.zeros((24, 3), dtype=np.float32),
        R_tpose_canonical=np.broadcast_to(np.eye(3, dtype=np.float32), (24, 3, 3)).copy(),
    )
    K_px = np.array([[16.0, 0.0, 8.0], [0.0, 16.0, 8.0], [0.0, 0.0, 1.0]])
    scene = pack_cloud(cloud, normals=True)
    size = (16, 16)
    # In sight, or nothing of the human would be projected: SMPL's (0, 0, 2) is (0, -2, 0) with z up.
    human = PosedHuman(
        avatar="warm",
        root_m=np.array([0.0, 2.0, 2.0]),
        pose_axis_angle=np.zeros((24, 3)),
        light=np.broadcast_to(np.eye(4), (3, 4, 4)).copy(),
    )
    view = View(T_world_camera=np.eye(4), humans=(human,))
    rasterizer = CpuRasterizer(scene, {"warm": avatar}, K_px, *size)
    rasterizer.render([view])
    rasterizer.render([view], outputs)
    skip, pixel_m = np.ones(1, dtype=np.int64), np.zeros(1)
    tree = ChunkTree(scene=scene, skip=skip, pixel_m=pixel_m)
    human_tree = AvatarTree(avatar=pack_avatar(avatar), skip=skip, pixel_m=pixel_m)
    CpuRasterizer(tree, {"warm": avatar}, K_px, *size, packed_avatars={"warm": human_tree}).render([view])
