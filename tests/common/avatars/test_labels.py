import dataclasses

import numpy as np
import pytest

from readygo.common.avatars import (
    Avatar,
    LabelModel,
    footprint_xy,
    human_labels,
    joint_positions,
    load_avatars,
    pose_avatar,
)
from readygo.common.avatars.labels import BOX_OPACITY_MIN, DIRECTIONS, FOOTPRINT_CELL_M, thin_points
from readygo.common.messages import Motion


@pytest.fixture(scope="module")
def avatar() -> Avatar:
    return next(iter(load_avatars().values()))


@pytest.fixture(scope="module")
def model(avatar: Avatar) -> LabelModel:
    return LabelModel.from_avatar(avatar)


def some_motion(seed: int, steps: int = 1) -> Motion:
    rng = np.random.default_rng(seed)
    pose = rng.normal(scale=0.35, size=(steps, 24, 3))
    pose[:, 0] = (0.1, rng.uniform(-3, 3), 0.0)
    return Motion(
        root_m=rng.normal(scale=5.0, size=(steps, 3)).astype(np.float32), pose_axis_angle=pose.astype(np.float32)
    )


def test_model_is_small(model: LabelModel) -> None:
    assert 300 < len(model.hull) <= 24 * len(DIRECTIONS)
    assert len(model.footprint.points_m) <= 1000
    assert len(model.skeleton.cloud) == 0


def test_directions_leave_no_gap() -> None:
    directions = np.array(DIRECTIONS, dtype=float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    any_way = np.random.default_rng(0).normal(size=(20_000, 3))
    any_way /= np.linalg.norm(any_way, axis=1, keepdims=True)
    assert len(directions) == 38
    assert np.degrees(np.arccos((any_way @ directions.T).max(axis=1))).max() < 24.5


def test_joints_are_those_of_the_skeleton(avatar: Avatar, model: LabelModel) -> None:
    motion = some_motion(1, steps=3)
    labels = human_labels(model, motion, 2, 0.3)
    np.testing.assert_array_equal(labels.joints_m, joint_positions(avatar, motion)[2].astype(np.float32))
    np.testing.assert_array_equal(labels.joints_m[0], motion.root_m[2])


@pytest.mark.parametrize("seed", range(6))
def test_box_is_that_of_all_solid_gaussians(avatar: Avatar, model: LabelModel, seed: int) -> None:
    motion, yaw_rad = some_motion(seed), 0.7 * seed
    box = human_labels(model, motion, 0, yaw_rad).box
    solid = avatar.cloud.opacities >= BOX_OPACITY_MIN
    points = pose_avatar(avatar, motion.root_m[0], motion.pose_axis_angle[0]).means_m[solid].astype(np.float64)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    in_box = (points - box[:3]) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert box[6] == yaw_rad
    np.testing.assert_allclose(in_box.max(axis=0), 0.5 * box[3:6], atol=0.015)
    np.testing.assert_allclose(in_box.min(axis=0), -0.5 * box[3:6], atol=0.015)


def test_faint_gaussians_do_not_widen_a_box(avatar: Avatar) -> None:
    means, opacities = avatar.cloud.means_m.copy(), avatar.cloud.opacities.copy()
    means[0], motion = (3.0, 3.0, 3.0), some_motion(2)
    boxes = []
    for opacity in (BOX_OPACITY_MIN - 0.01, BOX_OPACITY_MIN):
        opacities[0] = opacity
        cloud = dataclasses.replace(avatar.cloud, means_m=means, opacities=opacities.copy())
        model = LabelModel.from_avatar(dataclasses.replace(avatar, cloud=cloud))
        boxes.append(human_labels(model, motion, 0, 0.0).box)
    assert boxes[0][3:6].max() < 2.5
    assert boxes[1][3:6].max() > 2.5


def test_footprint_is_the_thinned_one_of_the_planner(avatar: Avatar, model: LabelModel) -> None:
    motion = some_motion(3)
    ground = human_labels(model, motion, 0, 0.0).footprint_xy_m
    every = footprint_xy(model.footprint, avatar, motion, 0)
    cells = {tuple(cell) for cell in np.floor(every / FOOTPRINT_CELL_M).astype(int).tolist()}
    assert 40 < len(ground) == len(cells) < len(every)
    away = np.linalg.norm(every[:, None] - ground[None], axis=2).min(axis=1)
    assert away.max() < FOOTPRINT_CELL_M * np.sqrt(2)


def test_thinning_takes_the_mean_of_each_cell() -> None:
    points = np.array([[0.26, 0.01], [0.01, 0.02], [-0.01, 0.04], [0.03, 0.04]])
    np.testing.assert_allclose(thin_points(points, 0.05), [[-0.01, 0.04], [0.02, 0.03], [0.26, 0.01]])
    assert thin_points(np.empty((0, 2)), 0.05).shape == (0, 2)


def test_last_row_is_held(model: LabelModel) -> None:
    motion = some_motion(4, steps=2)
    last, later = (human_labels(model, motion, step, 0.0) for step in (1, 9))
    for name in ("joints_m", "box", "footprint_xy_m"):
        np.testing.assert_array_equal(getattr(last, name), getattr(later, name))


def test_human_without_solid_gaussians_has_a_box(avatar: Avatar) -> None:
    faint = dataclasses.replace(avatar.cloud, opacities=np.full_like(avatar.cloud.opacities, 0.2))
    model = LabelModel.from_avatar(dataclasses.replace(avatar, cloud=faint))
    assert human_labels(model, some_motion(0), 0, 0.0).box[5] > 1.0


def test_labels_of_somebody_in_motion_are_as_they_were(avatar: Avatar, model: LabelModel, golden_figures) -> None:
    labels = human_labels(model, some_motion(4, steps=3), 1, 2.5)
    golden_figures("avatars/joints", labels.joints_m)
    golden_figures("avatars/box", [labels.box])
    golden_figures("avatars/footprint", 5.0 * labels.footprint_xy_m)
    points = 30.0 * model.footprint.points_m, model.footprint.weights, model.footprint.lbs_weight
    golden_figures("avatars/footprint model", *points)
