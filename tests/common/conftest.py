import importlib.util
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud

MakeCloud = Callable[..., GaussianCloud]


def _cloud(
    count: int, *, seed: int = 0, coefficients: int = 1, low: tuple[float, float, float] = (-4.0, -4.0, 0.0),
    high: tuple[float, float, float] = (4.0, 4.0, 3.0), scale_m: float = 0.05,
) -> GaussianCloud:  # fmt: skip
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(count, 4))
    sh = 0.25 * rng.normal(size=(count, coefficients, 3))
    sh[:, 0] = rng.uniform(-1.6, 1.6, size=(count, 3))
    return GaussianCloud(
        means_m=rng.uniform(low, high, size=(count, 3)).astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales_m=(scale_m * np.exp(rng.normal(size=(count, 3)))).astype(np.float32),
        opacities=rng.uniform(0.0, 1.0, size=count).astype(np.float32),
        sh=sh.astype(np.float32),
    )


@pytest.fixture(scope="session")
def make_cloud() -> MakeCloud:
    return _cloud


@pytest.fixture(scope="session")
def avatar() -> Avatar:
    """A ball of Gaussians around each joint of a stick figure; two to four joints move each of them."""
    rng = np.random.default_rng(5)
    joints = _stick_figure()
    count = 3000
    cloud = _cloud(count, seed=6, scale_m=0.015)
    home = rng.integers(0, 24, size=count)
    means = joints[home] + rng.normal(scale=0.06, size=(count, 3))
    distance = np.linalg.norm(means[:, None] - joints[None], axis=2)
    index = np.argsort(distance, axis=1)[:, :4]
    weight = np.exp(-10 * np.take_along_axis(distance, index, axis=1))
    weight[:, 2:] *= rng.integers(0, 2, size=(count, 1))
    weight[: count // 3, 1:] = 0.0
    return Avatar(
        name="stick",
        license="",
        height_m=1.7,
        cloud=GaussianCloud(
            means_m=means.astype(np.float32),
            quats_wxyz=cloud.quats_wxyz,
            scales_m=cloud.scales_m,
            opacities=cloud.opacities,
            sh=cloud.sh,
        ),
        lbs_index=index.astype(np.uint8),
        lbs_weight=(weight / weight.sum(axis=1, keepdims=True)).astype(np.float32),
        joints_canonical_m=joints.astype(np.float32),
        joints_tpose_m=joints.astype(np.float32),
        R_tpose_canonical=np.broadcast_to(np.eye(3, dtype=np.float32), (24, 3, 3)).copy(),
    )


def _stick_figure() -> Float64Array:
    from readygo.common.avatars import SMPL_PARENTS

    rng = np.random.default_rng(7)
    joints = np.zeros((24, 3))
    joints[0] = (0.0, 0.9, 0.0)
    for j in range(1, 24):
        step = rng.normal(size=3)
        joints[j] = joints[SMPL_PARENTS[j]] + 0.18 * step / np.linalg.norm(step)
    return joints


@pytest.fixture(scope="session")
def camera() -> Callable[..., tuple[Float64Array, Float64Array]]:
    """Makes a pose and intrinsics: position, heading, image width and height."""

    def make(
        x: float, y: float, yaw: float, width: int, height: int, pitch: float = 0.1
    ) -> tuple[Float64Array, Float64Array]:
        c, s = math.cos(yaw), math.sin(yaw)
        level = np.array([[s, 0.0, c], [-c, 0.0, s], [0.0, -1.0, 0.0]])
        cp, sp = math.cos(pitch), math.sin(pitch)
        T = np.eye(4)
        T[:3, :3] = level @ np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
        T[:3, 3] = (x, y, 1.2)
        focal = 0.42 * width
        return T, np.array([[focal, 0.0, 0.52 * width], [0.0, 1.1 * focal, 0.47 * height], [0.0, 0.0, 1.0]])

    return make


@pytest.fixture(scope="session")
def triton_device() -> Iterator[str]:
    """Where Triton kernels run here: a CUDA device, or the CPU under Triton's interpreter."""
    if importlib.util.find_spec("triton") is None:
        pytest.skip("triton is not installed (the extra `gpu`)")
    torch = pytest.importorskip("torch", reason="torch is not installed")
    if torch.cuda.is_available():
        yield "cuda"
        return
    # Triton decides when a kernel is defined: this must stand before the first import of one.
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRITON_INTERPRET", "1")
        yield "cpu"
