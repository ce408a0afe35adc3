import dataclasses

import numpy as np
import pytest

from readygo.common.avatars import Avatar, FootprintModel, footprint_xy, load_avatars, pose_avatar
from readygo.common.messages import Motion


@pytest.fixture(scope="module")
def avatar() -> Avatar:
    return next(iter(load_avatars().values()))


@pytest.fixture(scope="module")
def model(avatar: Avatar) -> FootprintModel:
    return FootprintModel.from_avatar(avatar)


def standing(avatar: Avatar, x_m: float = 0.0, steps: int = 1) -> Motion:
    root = np.tile(np.float32([x_m, 0.0, avatar.joints_tpose_m[0, 1]]), (steps, 1))
    root[:, 0] += np.arange(steps, dtype=np.float32)
    return Motion(root_m=root, pose_axis_angle=np.zeros((steps, 24, 3), dtype=np.float32))


def test_model_is_small_and_covers_the_human(avatar: Avatar, model: FootprintModel) -> None:
    assert 300 < len(model.points_m) <= 1000
    cloud = avatar.cloud.means_m
    np.testing.assert_allclose(model.points_m.min(axis=0), cloud.min(axis=0), atol=0.06)
    np.testing.assert_allclose(model.points_m.max(axis=0), cloud.max(axis=0), atol=0.06)


def test_blurry_gaussians_are_left_out(avatar: Avatar, model: FootprintModel) -> None:
    trace = (avatar.cloud.scales_m.astype(np.float64) ** 2).sum(axis=1)
    small = {tuple(point) for point in avatar.cloud.means_m[trace <= np.percentile(trace, 75)].astype(np.float64)}
    assert all(tuple(point) in small for point in model.points_m)


def test_weights_add_up_to_the_opacity_that_was_kept(avatar: Avatar, model: FootprintModel) -> None:
    trace = (avatar.cloud.scales_m.astype(np.float64) ** 2).sum(axis=1)
    kept = avatar.cloud.opacities[trace <= np.percentile(trace, 75)].astype(np.float64)
    assert model.weights.sum() == pytest.approx(kept.sum())


def few_points(avatar: Avatar, means_m: list[list[float]], opacities: list[float], scales_m: list[float]) -> Avatar:
    rows = np.arange(len(means_m))
    cloud = dataclasses.replace(
        avatar.cloud.select(rows),
        means_m=np.float32(means_m),
        opacities=np.float32(opacities),
        scales_m=np.outer(np.float32(scales_m), np.float32([1, 1, 1])),
    )
    return dataclasses.replace(
        avatar, cloud=cloud, lbs_index=avatar.lbs_index[rows], lbs_weight=avatar.lbs_weight[rows]
    )


def test_voxel_is_the_point_nearest_to_the_mean_by_opacity(avatar: Avatar) -> None:
    means_m = [[0.001, 1, 0], [0.02, 1, 0], [0.045, 1, 0], [0.2, 1, 0], [0.3, 1, 0]]
    few = few_points(avatar, means_m, [0.9, 0.1, 0.1, 0.4, 0.5], [0.01, 0.01, 0.01, 0.01, 0.09])
    model = FootprintModel.from_avatar(few, voxel_m=0.05)
    np.testing.assert_allclose(model.points_m[:, 0], [0.001, 0.2], atol=1e-6)
    np.testing.assert_allclose(model.weights, [1.1, 0.4], atol=1e-6)
    np.testing.assert_array_equal(model.lbs_index, avatar.lbs_index[[0, 3]])


@pytest.mark.parametrize(("limit", "points"), [(5, 5), (4, 4), (1, 1)])
def test_voxels_grow_by_tenths_from_the_first_point_beyond_the_limit(avatar: Avatar, limit: int, points: int) -> None:
    # Voxels of 5.5 cm join the first two alone.
    means_m = [[0.01, 0, 0], [0.052, 0, 0], [0.012, 0.06, 0], [0.012, 0, 0.06], [0.012, 0.06, 0.06]]
    few = few_points(avatar, means_m, [0.5] * 5, [0.01] * 5)
    assert len(FootprintModel.from_avatar(few, voxel_m=0.05, point_limit=limit).points_m) == points


def test_points_limit_holds_for_a_fine_grid(avatar: Avatar) -> None:
    assert len(FootprintModel.from_avatar(avatar, voxel_m=0.01, point_limit=200).points_m) <= 200


def test_footprint_equals_the_posed_gaussians(avatar: Avatar, model: FootprintModel) -> None:
    rng = np.random.default_rng(0)
    motion = Motion(
        root_m=rng.normal(size=(1, 3)).astype(np.float32),
        pose_axis_angle=rng.normal(scale=0.4, size=(1, 24, 3)).astype(np.float32),
    )
    posed = pose_avatar(avatar, motion.root_m[0], motion.pose_axis_angle[0]).means_m
    place = {tuple(mean): n for n, mean in enumerate(avatar.cloud.means_m.astype(np.float64))}
    rows = [place[tuple(point)] for point in model.points_m]
    np.testing.assert_allclose(footprint_xy(model, avatar, motion, 0), posed[rows, :2], atol=1e-5)


def test_low_limit_leaves_only_legs(avatar: Avatar, model: FootprintModel) -> None:
    motion = standing(avatar)
    everything, low = footprint_xy(model, avatar, motion, 0), footprint_xy(model, avatar, motion, 0, z_max_m=0.5)
    assert 0 < len(low) < len(everything) / 2
    assert np.abs(low).max() < 0.45 < np.abs(everything).max()
    assert len(footprint_xy(model, avatar, motion, 0, z_max_m=-1.0)) == 0


def test_last_row_is_held(avatar: Avatar, model: FootprintModel) -> None:
    motion = standing(avatar, steps=3)
    last = footprint_xy(model, avatar, motion, 2)
    np.testing.assert_array_equal(footprint_xy(model, avatar, motion, 99), last)
    np.testing.assert_allclose(last - footprint_xy(model, avatar, motion, 0), [[2.0, 0.0]] * len(last), atol=1e-6)


def test_wrong_settings_are_refused(avatar: Avatar) -> None:
    with pytest.raises(ValueError, match="positive"):
        FootprintModel.from_avatar(avatar, voxel_m=0.0)
