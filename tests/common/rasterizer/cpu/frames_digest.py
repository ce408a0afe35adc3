"""Prints a hash of packed arrays and frames; run by a test under different instruction sets.

With numbers of frames as arguments: the hash of each of these frames, drawn in this order. With the name of a file:
saves the frames there.
"""

import dataclasses
import hashlib
import math
import sys
from collections.abc import Iterable

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud
from readygo.common.images.images import OUTPUTS
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman
from readygo.common.rasterizer.packed.scene import PackedScene, pack_cloud
from tests.common.rasterizer.drawing import float_rgb_of, images_of, numbered


def cloud(count: int, coefficients: int, spread_m: float) -> GaussianCloud:
    rng = np.random.default_rng(count)
    quats = rng.uniform(-1.0, 1.0, size=(count, 4))
    return GaussianCloud(
        means_m=rng.uniform(-spread_m, spread_m, size=(count, 3)).astype(np.float32),
        quats_wxyz=quats.astype(np.float32),
        scales_m=rng.uniform(0.002, 0.2, size=(count, 3)).astype(np.float32),
        opacities=rng.uniform(0.0, 1.0, size=count).astype(np.float32),
        sh=rng.uniform(-1.0, 1.0, size=(count, coefficients, 3)).astype(np.float32),
    )


def avatar() -> Avatar:
    rng = np.random.default_rng(3)
    joints = rng.uniform(-0.6, 0.6, size=(24, 3)).astype(np.float32)
    weight = rng.integers(1, 8, size=(2000, 4)).astype(np.float32)
    return Avatar(
        name="noise",
        license="",
        height_m=1.7,
        cloud=cloud(2000, 1, 0.7),
        lbs_index=rng.integers(0, 24, size=(2000, 4)).astype(np.uint8),
        lbs_weight=weight / weight.sum(axis=1, keepdims=True),
        joints_canonical_m=joints,
        joints_tpose_m=joints,
        R_tpose_canonical=np.broadcast_to(np.eye(3, dtype=np.float32), (24, 3, 3)).copy(),
    )


def packed_scenes() -> list[PackedScene]:
    return [pack_cloud(cloud(20000, 1, 5.0), normals=True), pack_cloud(cloud(3000, 16, 60.0), normals=True)]


def make_rasterizer(scenes: list[PackedScene]) -> CpuRasterizer:
    K = np.array([[60.0, 0.0, 64.0], [0.0, 60.0, 40.0], [0.0, 0.0, 1.0]])
    return CpuRasterizer(scenes, numbered([avatar()]), K, 80, 128)


def view(k: int) -> tuple[Float64Array, list[PosedHuman]]:
    c, s = math.cos(0.7 * k), math.sin(0.7 * k)
    T = np.array([[s, 0.0, c, -2.0 * c], [-c, 0.0, s, -2.0 * s], [0.0, -1.0, 0.0, 0.1 * k], [0.0, 0.0, 0.0, 1.0]])
    pose = 0.3 * np.sin(np.arange(72.0) * (k + 1)).reshape(24, 3)
    light = np.eye(4) * np.array([0.4, 0.9, 1.6])[:, None, None] + 0.1 * k if k % 3 else None
    stand = {"light": light, "ground_m": -0.3, "lead_m": 0.4 * (k % 2)}
    return T, [PosedHuman(avatar="0", root_m=np.zeros(3), pose_axis_angle=pose, **stand)] * (1 + k % 2)


def frames(scenes: list[PackedScene], numbers: Iterable[int]) -> list[Float32Array]:
    rasterizer = make_rasterizer(scenes)
    return [float_rgb_of(rasterizer, *view(k)) for k in numbers]


def digest_of_everything() -> str:
    digest = hashlib.sha256()
    scenes = packed_scenes()
    for scene in scenes:
        for array in (scene.centre_m, scene.geometry, scene.colour, scene.sh, scene.normal):
            digest.update(array.tobytes())
    for frame in frames(scenes, range(4)):
        digest.update(frame)
    rasterizer = make_rasterizer(scenes)
    for k, outputs in ((0, ("depth", "mask")), (1, OUTPUTS), (2, OUTPUTS)):
        images = images_of(rasterizer, *view(k), outputs)
        for array in (getattr(images, field.name) for field in dataclasses.fields(images)):
            digest.update(b"" if array is None else array)
    return digest.hexdigest()


def main(arguments: list[str]) -> str:
    if not arguments:
        return digest_of_everything()
    if not arguments[0].isdigit():
        np.save(arguments[0], np.stack(frames(packed_scenes(), range(4))))
        return ""
    chosen = frames(packed_scenes(), map(int, arguments))
    return "\n".join(hashlib.sha256(frame).hexdigest() for frame in chosen)


if __name__ == "__main__":
    print(main(sys.argv[1:]))  # noqa: T201
