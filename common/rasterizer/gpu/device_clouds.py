"""Scenes and avatars in the memory of a device, as the Triton kernels read them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from readygo.common.arrays import Int32Array
from readygo.common.avatars import Avatar
from readygo.common.avatars.torch_posing import Skeletons, load_skeletons
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.gpu.chunks import ChunkedCloud, chunk_avatar, chunk_cloud
from readygo.common.rasterizer.packed.scene import CHUNK, GEOMETRY_ROWS


@dataclass(frozen=True, kw_only=True, eq=False)
class DeviceClouds:
    """The chunks of all scenes, then those of all avatars; C chunks, of which D belong to avatars."""

    scene_chunks: int
    """Number of the scenes' chunks, C - D."""
    human_chunks: int
    """Chunks of the largest avatar."""
    sh_count: int
    """SH coefficients per channel, 1, 4, 9 or 16: the largest number of any cloud."""
    box_count: int
    """Boxes per chunk of an avatar."""
    centres: Tensor
    """Centres of the scenes' chunks [m], float64, shape (C - D, 3)."""
    halves: Tensor
    """Half sizes of the boxes around their means [m], shape (C - D, 3)."""
    reaches: Tensor
    """How far the Gaussians of each chunk reach [m], shape (C,)."""
    geometry: Tensor
    """Mean, covariance, log2 opacity and squared reach, the rows of `GEOMETRY_ROWS`, shape (C, 11, 256)."""
    colours: Tensor
    """Colours of degree 0, not clamped, shape (C, 3, 256)."""
    normals: Tensor
    """Shortest axis of each Gaussian, in the frame of its covariance, shape (C, 3, 256)."""
    sh: Tensor
    """Higher coefficients of the S chunks that have them, filled up with zeros, shape (S, sh_count - 1, 3, 256)."""
    sh_rows: Tensor
    """Row in `sh` of each chunk, -1: none, int32, shape (C,)."""
    first_chunks: Tensor
    """First chunk of each avatar, counted from the first avatar's, int32, shape (A,)."""
    chunk_counts: Tensor
    """Number of each avatar's chunks, int32, shape (A,)."""
    joints: Tensor
    """Joints that move each Gaussian of the avatars, uint8, shape (D, 4, 256)."""
    weights: Tensor
    """Skinning weights of these joints, shape (D, 4, 256)."""
    shading: Tensor
    """Normals of the avatars that light falls on, shape (D, 3, 256)."""
    box_joints: Tensor
    """Joint that carries each box of an avatar's chunk, -1: no box, int32, shape (D, box_count)."""
    box_centres: Tensor
    """Centres of these boxes [m], shape (D, box_count, 3)."""
    box_halves: Tensor
    """Half sizes of these boxes [m], shape (D, box_count, 3)."""
    skeletons: Skeletons
    """Joints of the avatars."""


def upload(scenes: Sequence[GaussianCloud], avatars: Sequence[Avatar], device: torch.device | str) -> DeviceClouds:
    """Cut clouds and avatars into chunks and copy them to a device."""
    layers = [chunk_cloud(scene) for scene in scenes]
    humans = [chunk_avatar(avatar) for avatar in avatars]
    clouds = [*layers, *(human.cloud for human in humans)]
    counts = np.array([human.cloud.chunk_count for human in humans], dtype=np.int32)
    boxes = max((human.box_joint.shape[1] for human in humans), default=1)
    bands = max((cloud.sh.shape[1] for cloud in clouds if cloud.chunk_count), default=0)
    sh, sh_rows = _sh(clouds, bands)

    def on_device(array: npt.NDArray[np.generic]) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(device)

    def upload_rows(arrays: Sequence[npt.NDArray[np.generic]], shape: tuple[int, ...], dtype: npt.DTypeLike) -> Tensor:
        return on_device(np.concatenate([np.zeros((0, *shape), dtype=dtype), *arrays]))

    return DeviceClouds(
        scene_chunks=sum(layer.chunk_count for layer in layers),
        human_chunks=int(counts.max(initial=0)),
        sh_count=bands + 1,
        box_count=boxes,
        centres=upload_rows([layer.centre_m for layer in layers], (3,), np.float64),
        halves=upload_rows([layer.half_m for layer in layers], (3,), np.float32),
        reaches=upload_rows([cloud.reach_m for cloud in clouds], (), np.float32),
        geometry=upload_rows([cloud.geometry for cloud in clouds], (GEOMETRY_ROWS, CHUNK), np.float32),
        colours=upload_rows([cloud.colour for cloud in clouds], (3, CHUNK), np.float32),
        normals=upload_rows([cloud.normal for cloud in clouds], (3, CHUNK), np.float32),
        sh=on_device(sh),
        sh_rows=on_device(sh_rows),
        first_chunks=on_device(np.cumsum(counts, dtype=np.int32) - counts),
        chunk_counts=on_device(counts),
        joints=upload_rows([human.joint for human in humans], (4, CHUNK), np.uint8),
        weights=upload_rows([human.weight for human in humans], (4, CHUNK), np.float32),
        shading=upload_rows([human.shading for human in humans], (3, CHUNK), np.float32),
        box_joints=upload_rows([_widen_rows(p.box_joint, boxes, -1) for p in humans], (boxes,), np.int32),
        box_centres=upload_rows([_widen_rows(p.box_centre_m, boxes, 0) for p in humans], (boxes, 3), np.float32),
        box_halves=upload_rows([_widen_rows(p.box_half_m, boxes, 0) for p in humans], (boxes, 3), np.float32),
        skeletons=load_skeletons(avatars, device),
    )


def _sh(clouds: Sequence[ChunkedCloud], bands: int) -> tuple[npt.NDArray[np.float16], Int32Array]:
    """Higher coefficients of the clouds that have any, and each chunk's row there."""
    blocks, rows, used = [np.zeros((0, bands, 3, CHUNK), dtype=np.float16)], [np.zeros(0, dtype=np.int32)], 0
    for cloud in clouds:
        if cloud.sh.shape[1] == 0:
            rows.append(np.full(cloud.chunk_count, -1, dtype=np.int32))
            continue
        blocks.append(_widen_rows(cloud.sh, bands, 0).astype(np.float16))
        rows.append(np.arange(used, used + cloud.chunk_count, dtype=np.int32))
        used += cloud.chunk_count
    return np.concatenate(blocks), np.concatenate(rows)


def _widen_rows(array: npt.NDArray[np.generic], size: int, value: float) -> npt.NDArray[np.generic]:
    """The array with axis 1 filled up to `size`."""
    missing = size - array.shape[1]
    return np.pad(array, [(0, 0), (0, missing), *[(0, 0)] * (array.ndim - 2)], constant_values=value)
