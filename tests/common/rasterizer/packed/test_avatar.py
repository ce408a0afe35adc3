"""Avatars packed in blocks of 16 Gaussians that the same few joints move."""

from dataclasses import replace

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.rasterizer.packed.avatar import PackedAvatar, pack_avatar
from readygo.common.rasterizer.packed.scene import CHUNK


@pytest.fixture(scope="module")
def packed(avatar: Avatar) -> PackedAvatar:
    return pack_avatar(avatar)


def places(packed: PackedAvatar) -> tuple[np.ndarray, np.ndarray]:
    """Means of all places, and at which of them there is a Gaussian."""
    geometry = packed.scene.geometry
    drawn = (geometry[:, :, 10] >= 0).reshape(-1)
    return geometry[:, :, :3].transpose(0, 1, 3, 2).reshape(-1, 3), drawn


def dense_weights(packed: PackedAvatar) -> np.ndarray:
    """Weight of every joint at every place."""
    blocks = len(packed.joint_start) - 1
    dense = np.zeros((blocks, 16, 24), np.float32)
    dense[np.repeat(np.arange(blocks), np.diff(packed.joint_start)), :, packed.joint] = packed.weight
    return dense.reshape(-1, 24)


def test_every_visible_gaussian_keeps_its_place_and_its_weights(avatar: Avatar, packed: PackedAvatar) -> None:
    visible = avatar.cloud.opacities >= np.float32(1 / 255)
    expected = np.zeros((len(visible), 24), np.float32)
    for k in range(4):
        np.add.at(expected, (np.arange(len(visible)), avatar.lbs_index[:, k]), avatar.lbs_weight[:, k])
    means, drawn = places(packed)
    assert drawn.sum() == visible.sum() < len(visible)
    found, wanted = means[drawn], avatar.cloud.means_m[visible]
    orders = np.lexsort(found.T), np.lexsort(wanted.T)
    assert np.array_equal(found[orders[0]], wanted[orders[1]])
    assert dense_weights(packed)[drawn][orders[0]] == pytest.approx(expected[visible][orders[1]], abs=1e-7)
    assert not dense_weights(packed)[~drawn].any()


def test_joint_that_two_entries_name_has_the_sum_of_their_weights(avatar: Avatar) -> None:
    index = avatar.lbs_index.copy()
    index[:, 1] = index[:, 0]
    packed = pack_avatar(replace(avatar, lbs_index=index))
    _, drawn = places(packed)
    assert dense_weights(packed)[drawn].sum(axis=1) == pytest.approx(np.ones(drawn.sum()), abs=1e-6)


def test_gaussians_of_the_same_joints_share_blocks(packed: PackedAvatar) -> None:
    """A third of the Gaussians have one joint; sorted by their place alone, few blocks would have."""
    per_block = np.diff(packed.joint_start)
    assert (per_block == 1).sum() > 30
    assert per_block[per_block > 0].mean() < 4.0


def test_box_of_a_joint_holds_the_means_of_its_chunk_that_the_joint_moves(packed: PackedAvatar) -> None:
    means, drawn = places(packed)
    weights = dense_weights(packed)
    assert len(packed.box_start) == packed.scene.chunk_count + 1
    for chunk in range(packed.scene.chunk_count):
        boxes = range(packed.box_start[chunk], packed.box_start[chunk + 1])
        inside = slice(chunk * CHUNK, (chunk + 1) * CHUNK)
        moving = np.flatnonzero((weights[inside] != 0).any(axis=0))
        assert [packed.box_joint[b] for b in boxes] == moving.tolist()
        for b in boxes:
            moved = means[inside][drawn[inside] & (weights[inside, packed.box_joint[b]] != 0)]
            offset = np.abs(moved - packed.box_centre_m[b])
            assert (offset <= packed.box_half_m[b] + 1e-6).all()
            # The box is no larger than it must be.
            assert offset.max(axis=0) == pytest.approx(packed.box_half_m[b], abs=1e-5)
