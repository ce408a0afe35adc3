"""Prints a hash of packed arrays and frames, and saves the frames to a file if one is named.

Run by a test under different instruction sets.
"""

import dataclasses
import hashlib
import math
import sys

import numpy as np

from common.avatars import Avatar
from common.gaussians import GaussianCloud
from common.rasterizer.cpu import CpuRasterizer, PosedPerson
from common.rasterizer.images import OUTPUTS
from common.rasterizer.packed import pack_cloud


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


def main() -> str:
    digest = hashlib.sha256()
    scenes = [pack_cloud(cloud(20000, 1, 5.0), normals=True), pack_cloud(cloud(3000, 16, 60.0), normals=True)]
    for scene in scenes:
        for array in (scene.centre_m, scene.geometry, scene.colour, scene.sh, scene.normal):
            digest.update(array.tobytes())
    K = np.array([[60.0, 0.0, 64.0], [0.0, 60.0, 40.0], [0.0, 0.0, 1.0]])
    rasterizer = CpuRasterizer(scenes, [avatar()], K, 80, 128)
    frames = []
    for k in range(4):
        c, s = math.cos(0.7 * k), math.sin(0.7 * k)
        T = np.array([[s, 0.0, c, -2.0 * c], [-c, 0.0, s, -2.0 * s], [0.0, -1.0, 0.0, 0.1 * k], [0.0, 0.0, 0.0, 1.0]])
        pose = 0.3 * np.sin(np.arange(72.0) * (k + 1)).reshape(24, 3)
        person = PosedPerson(avatar=0, root_m=np.zeros(3), pose_axis_angle=pose)
        frames.append(rasterizer.render_float(T, [person]))
        digest.update(frames[-1])
        for outputs in (("depth", "mask"), OUTPUTS):
            images = rasterizer.render_images(T, [person], outputs)
            for array in (getattr(images, field.name) for field in dataclasses.fields(images)):
                digest.update(b"" if array is None else array)
    for path in sys.argv[1:]:
        np.save(path, np.stack(frames))
    return digest.hexdigest()


if __name__ == "__main__":
    print(main())  # noqa: T201
