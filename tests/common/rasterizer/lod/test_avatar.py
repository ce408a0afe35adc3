import itertools
from dataclasses import replace

import numpy as np
import pytest

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar, load_avatars
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman
from readygo.common.rasterizer.lod.avatar import AvatarTree, build_avatar_tree
from readygo.common.rasterizer.packed.avatar import PackedAvatar, pack_avatar
from readygo.common.rasterizer.packed.scene import PackedScene, pack_cloud
from readygo.common.robot import CameraConfig
from tests.common.rasterizer.drawing import float_rgb_of, numbered, rgb_of
from tests.common.rasterizer.lod.lod_scenes import psnr_db

CAMERA = CameraConfig()
T = CAMERA.T_world_camera(0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def somebody() -> Avatar:
    return next(iter(load_avatars().values()))


@pytest.fixture(scope="module")
def packed(somebody: Avatar) -> PackedAvatar:
    return pack_avatar(somebody)


@pytest.fixture(scope="module")
def tree(packed: PackedAvatar) -> AvatarTree:
    return build_avatar_tree(packed)


@pytest.fixture(scope="module")
def wall() -> PackedScene:
    """A wall of large patches at 9 m."""
    rng = np.random.default_rng(0)
    count = 300
    means = np.stack([np.full(count, 9.0), rng.uniform(-14, 14, count), rng.uniform(-5, 7, count)], axis=1)
    return pack_cloud(
        GaussianCloud(
            means_m=means.astype(np.float32),
            quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
            scales_m=np.ones((count, 3), dtype=np.float32),
            opacities=np.full(count, 0.9, dtype=np.float32),
            sh=rng.uniform(0, 1.5, (count, 1, 3)).astype(np.float32),
        )
    )


def rasterizer(wall, avatar, packed: PackedAvatar | AvatarTree) -> CpuRasterizer:
    return CpuRasterizer(wall, numbered([avatar]), CAMERA.K_px, 144, 256, packed_avatars=numbered([packed]))


def at(x_m: float) -> list[PosedHuman]:
    pose: Float64Array = 0.3 * np.sin(np.arange(72.0)).reshape(24, 3)
    pose[0] = (0.0, 1.0, 0.0)
    return [PosedHuman(avatar="0", root_m=np.array([x_m, 0.2, 0.95]), pose_axis_angle=pose)]


def test_tree_without_coarse_nodes_has_the_bytes_of_the_exact_image(wall, somebody, packed, tree) -> None:
    exact = rgb_of(rasterizer(wall, somebody, packed), T, at(2.0))
    fine = replace(tree, pixel_m=np.where(tree.pixel_m > 0, np.inf, 0.0))
    assert np.array_equal(rgb_of(rasterizer(wall, somebody, fine), T, at(2.0)), exact)
    assert psnr_db(exact, rgb_of(rasterizer(wall, somebody, packed), T)) < 30


@pytest.mark.parametrize(("distance_m", "share"), [(1.5, 0.6), (4.0, 0.25), (7.0, 0.2)])
def test_far_humans_have_fewer_gaussians_and_look_alike(
    wall, somebody, packed, tree, distance_m: float, share: float
) -> None:
    exact, coarse = rasterizer(wall, somebody, packed), rasterizer(wall, somebody, tree)
    assert psnr_db(rgb_of(exact, T, at(distance_m)), rgb_of(coarse, T, at(distance_m))) > 43
    assert coarse._ws.counts[0] < share * exact._ws.counts[0]


def test_nobody_pops_while_walking_from_1_to_8_m(wall, somebody, packed, tree) -> None:
    """From centimetre to centimetre the image changes by no more than the exact one does, but for 0.2 of 255."""
    images = []
    for one in (packed, tree):
        draw = rasterizer(wall, somebody, one)
        images.append([float_rgb_of(draw, T, at(1.0 + 0.01 * k)) * 255 for k in range(701)])
    exact, coarse = (np.array([np.sqrt(((a - b) ** 2).mean()) for a, b in itertools.pairwise(row)]) for row in images)
    assert (coarse - exact).max() < 0.2
    assert coarse.mean() < exact.mean()


def test_joints_carry_merged_gaussians_with_whole_weights(tree: AvatarTree) -> None:
    avatar = tree.avatar
    blocks = len(avatar.joint_start) - 1
    total = np.zeros((blocks, 16))
    np.add.at(total, np.repeat(np.arange(blocks), np.diff(avatar.joint_start)), avatar.weight)
    drawn = avatar.scene.geometry[:, :, -1].reshape(blocks, 16) >= 0
    assert np.allclose(total[drawn], 1.0, atol=1e-3)
    assert (total[~drawn] == 0).all()


def test_boxes_of_a_node_hold_its_means(tree: AvatarTree) -> None:
    avatar = tree.avatar
    for k in range(len(tree.skip)):
        moved = range(int(avatar.box_start[k]), int(avatar.box_start[k + 1]))
        boxes = {int(avatar.box_joint[b]): (avatar.box_centre_m[b], avatar.box_half_m[b]) for b in moved}
        for block in range(16 * k, 16 * k + 16):
            means = avatar.scene.geometry[k, block % 16, :3].T
            for row in range(avatar.joint_start[block], avatar.joint_start[block + 1]):
                centre, half = boxes[int(avatar.joint[row])]
                assert (np.abs(means - centre) <= half + 1e-5)[avatar.weight[row] > 0].all()


def test_packs_of_other_avatars_are_refused(wall, somebody, tree) -> None:
    with pytest.raises(ValueError, match="must be those of"):
        CpuRasterizer(wall, numbered([somebody, somebody]), CAMERA.K_px, 144, 256, packed_avatars=numbered([tree]))
