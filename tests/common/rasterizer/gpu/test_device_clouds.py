import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.rasterizer.gpu.chunks import chunk_avatar, chunk_cloud  # noqa: E402
from readygo.common.rasterizer.gpu.device_clouds import upload  # noqa: E402


def test_chunks_of_scenes_come_before_those_of_avatars(make_cloud, avatar, small_avatar) -> None:
    near, sky = make_cloud(600), make_cloud(40, seed=1)
    parts = [chunk_cloud(near), chunk_cloud(sky), chunk_avatar(avatar).cloud, chunk_avatar(small_avatar).cloud]
    counts = [part.chunk_count for part in parts]
    clouds = upload([near, sky], [avatar, small_avatar], "cpu")
    assert clouds.scene_chunks == counts[0] + counts[1] == len(clouds.centres)
    assert clouds.human_chunks == counts[2] > counts[3]
    assert clouds.first_chunks.tolist() == [0, counts[2]]
    assert clouds.chunk_counts.tolist() == counts[2:]
    assert np.array_equal(clouds.geometry.numpy(), np.concatenate([part.geometry for part in parts]))
    assert np.array_equal(clouds.reaches.numpy(), np.concatenate([part.reach_m for part in parts]))


def test_only_chunks_with_higher_harmonics_have_rows_of_them(make_cloud, small_avatar) -> None:
    rich, plain, richer = make_cloud(300, coefficients=4), make_cloud(30), make_cloud(30, coefficients=9, seed=1)
    parts = [chunk_cloud(cloud) for cloud in (rich, plain, richer)]
    clouds = upload([rich, plain, richer], [small_avatar], "cpu")
    assert clouds.sh_count == 9
    assert clouds.sh_rows.tolist() == [0, 1, -1, 2, -1]
    assert clouds.sh[:2, :3].numpy() == pytest.approx(parts[0].sh, abs=1e-3)
    assert not clouds.sh[:2, 3:].any()
    assert clouds.sh[2].numpy() == pytest.approx(parts[2].sh[0], abs=1e-3)


def test_boxes_of_avatars_are_filled_up_with_boxes_of_no_joint(avatar, small_avatar) -> None:
    large, small = chunk_avatar(avatar), chunk_avatar(small_avatar)
    clouds = upload([], [small_avatar, avatar], "cpu")
    widths = small.box_joint.shape[1], large.box_joint.shape[1]
    assert clouds.box_count == max(widths)
    assert np.array_equal(clouds.box_joints[0, : widths[0]].numpy(), small.box_joint[0])
    assert (clouds.box_joints[0, widths[0] :] == -1).all()
    assert np.array_equal(clouds.box_centres[1:, : widths[1]].numpy(), large.box_centre_m)


def test_nothing_can_be_uploaded_too() -> None:
    clouds = upload([], [], "cpu")
    assert (clouds.scene_chunks, clouds.human_chunks, clouds.sh_count) == (0, 0, 1)
    assert clouds.geometry.shape[0] == 0
