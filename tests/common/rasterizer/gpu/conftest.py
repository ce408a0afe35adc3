from collections.abc import Callable, Sequence

import numpy as np
import pytest

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar, pose_avatar
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.rasterizer.interface import PosedHuman

Pose = tuple[Float64Array, Float64Array]


@pytest.fixture(scope="session")
def small_avatar(avatar: Avatar) -> Avatar:
    """A few Gaussians of the stick figure: Triton's interpreter takes a millisecond for each in a tile."""
    index = np.random.default_rng(0).permutation(len(avatar.cloud))[:150]
    return Avatar(
        name="small",
        license="",
        height_m=avatar.height_m,
        cloud=avatar.cloud.select(index),
        lbs_index=avatar.lbs_index[index],
        lbs_weight=avatar.lbs_weight[index],
        joints_canonical_m=avatar.joints_canonical_m,
        joints_tpose_m=avatar.joints_tpose_m,
        R_tpose_canonical=avatar.R_tpose_canonical,
    )


@pytest.fixture(scope="session")
def human() -> Callable[..., PosedHuman]:
    """Makes a human in a random pose at a place."""

    def make(x_m: float, y_m: float, *, avatar: int = 0, seed: int = 1) -> PosedHuman:
        pose = 0.5 * np.random.default_rng(seed).normal(size=(24, 3))
        return PosedHuman(avatar=str(avatar), root_m=np.array([x_m, y_m, 1.0]), pose_axis_angle=pose)

    return make


@pytest.fixture(scope="session")
def posed() -> Callable[..., GaussianCloud]:
    """The scene and its humans as one cloud."""

    def make(cloud: GaussianCloud, avatars: Sequence[Avatar], humans: Sequence[PosedHuman]) -> GaussianCloud:
        bodies = [pose_avatar(avatars[int(p.avatar)], p.root_m, p.pose_axis_angle) for p in humans]
        return concatenate([cloud, *bodies]) if bodies else cloud

    return make
