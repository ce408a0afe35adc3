"""Simulated films of avatars: the same from the same seed, with the truth and disturbed poses beside it."""

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar, disturb_mask, disturb_poses, film_motion
from readygo.common.avatars import Avatar, joint_positions
from readygo.common.errors import AvatarError, ConfigError
from readygo.common.frames import axis_angle_from_matrix, matrix_from_axis_angle
from readygo.runs.scene_argument import open_scene
from readygo.services.reconstructor.avatars.footage import read_footage, read_views
from readygo.services.reconstructor.avatars.keypoints import read_keypoints
from tests.common.avatars.coarse import coarse_avatar

CONFIG = AvatarCaptureConfig(frames=8, width_px=64, height_px=64)


@pytest.fixture(scope="module")
def person() -> Avatar:
    return coarse_avatar()


def test_film_has_the_person_in_image_and_mask(person: Avatar, tmp_path: Path) -> None:
    done: list[int] = []
    capture_avatar(person, tmp_path / "film", CONFIG, done.append)
    assert done == list(range(1, 9))
    truth = np.load(tmp_path / "film" / "truth.npz")
    footage = read_footage(tmp_path / "film")
    np.testing.assert_allclose(footage.T_world_camera, truth["T_world_camera"], atol=1e-6)
    for number, (path, joints) in enumerate(zip(footage.masks, truth["joints_m"], strict=True)):
        mask = cv2.imread(str(path))[:, :, 0]
        assert set(np.unique(mask)) == {0, 255}
        T, K = footage.T_world_camera[number], footage.K_px[number]
        p = (joints[[0, 3, 6]] - T[:3, 3]) @ T[:3, :3]
        u, v = (K[0, 0] * p[:, 0] / p[:, 2] + K[0, 2]), (K[1, 1] * p[:, 1] / p[:, 2] + K[1, 2])
        assert (mask[v.astype(int), u.astype(int)] == 255).all()
    facts = json.loads((tmp_path / "film" / "truth.json").read_text())
    assert facts["frames"] == 8
    with pytest.raises(AvatarError, match="is there already"):
        capture_avatar(person, tmp_path / "film", CONFIG, done.append)


def test_same_seed_gives_the_same_film(person: Avatar, tmp_path: Path) -> None:
    for name in ("one", "two"):
        capture_avatar(person, tmp_path / name, CONFIG, lambda _: None)
    files = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*.png"))
    assert len(files) == 16
    assert all((tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes() for file in files)
    films = [read_footage(tmp_path / name) for name in ("one", "two")]
    np.testing.assert_array_equal(films[0].pose_axis_angle, films[1].pose_axis_angle)


def test_noise_has_the_asked_size(person: Avatar) -> None:
    config = AvatarCaptureConfig(motion="turn", frames=100, pose_noise_deg=3.0, pose_noise_m=0.02)
    motion = film_motion(person, config)
    pose, root = disturb_poses(motion, config, np.random.default_rng(0))
    R = np.swapaxes(matrix_from_axis_angle(motion.pose_axis_angle), -1, -2) @ matrix_from_axis_angle(pose)
    assert np.degrees(axis_angle_from_matrix(R)).std() == pytest.approx(3.0, rel=0.05)
    assert (root - motion.root_m).std() == pytest.approx(0.02, rel=0.1)


def test_masks_with_errors_have_dents_and_bumps_of_the_asked_size() -> None:
    mask = np.tile(np.arange(400) < 200, (4000, 1))
    assert disturb_mask(mask, 0.0, np.random.default_rng(0)) is mask
    for noise_px in (2.0, 4.0):
        found = disturb_mask(mask, noise_px, np.random.default_rng(0))
        moved = found.sum(axis=1) - 200.0
        assert np.std(moved) == pytest.approx(noise_px, rel=0.2)
        assert abs(np.mean(moved)) < 0.5


def test_film_in_a_scene_has_the_persons_place_in_each_image(person: Avatar, tmp_path: Path) -> None:
    scene = open_scene("embedded")
    config = dataclasses.replace(CONFIG, walk_radius_m=0.6)
    capture_avatar(person, tmp_path / "room", config, lambda _: None)
    capture_avatar(person, tmp_path / "scene", config, lambda _: None, scene)
    room, there = (np.load(tmp_path / name / "truth.npz") for name in ("room", "scene"))
    for number in range(CONFIG.frames):
        seen = [
            (film["joints_m"][number] - film["T_world_camera"][number][:3, 3]) @ film["T_world_camera"][number][:3, :3]
            for film in (room, there)
        ]
        np.testing.assert_allclose(seen[0], seen[1], atol=1e-4)
    images = [cv2.imread(str(tmp_path / name / "images" / "00000.png")).astype(float) for name in ("room", "scene")]
    mask = cv2.imread(str(tmp_path / "scene" / "segmentations" / "00000.png"))[:, :, 0] > 0
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert np.abs(images[0] - images[1])[inner].mean() < 3.0
    assert np.abs(images[0] - images[1])[~mask].mean() > 10.0
    alone = cv2.imread(str(tmp_path / "room" / "segmentations" / "00000.png"))[:, :, 0] > 0
    assert not (mask & ~alone).any()
    assert 0.5 * alone.sum() < mask.sum() <= alone.sum()
    over = dataclasses.replace(config, scene_hides=False)
    capture_avatar(person, tmp_path / "over", over, lambda _: None, scene)
    whole = cv2.imread(str(tmp_path / "over" / "segmentations" / "00000.png"))[:, :, 0] > 0
    assert whole.sum() > mask.sum(), "floors lie over feet"
    shown = cv2.imread(str(tmp_path / "over" / "images" / "00000.png")).astype(float)
    far = cv2.dilate(whole.astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
    assert np.abs(shown - images[1])[far].max() <= 1.0
    x, y = np.median(there["root_m"][:, :2], axis=0).tolist()
    floor = scene.maps.floor.at(x, y)
    assert there["joints_m"][:, [10, 11], 2].min() == pytest.approx(floor, abs=0.15)


def test_turning_shows_all_sides_with_feet_on_the_floor(person: Avatar) -> None:
    motion = film_motion(person, AvatarCaptureConfig(motion="turn", frames=40))
    facing = matrix_from_axis_angle(motion.pose_axis_angle[:, 0])[:, :, 2]
    yaw = np.unwrap(np.arctan2(facing[:, 0], facing[:, 2]))
    assert abs(yaw[-1] - yaw[0]) == pytest.approx(2 * np.pi * 39 / 40, abs=0.02)
    ankles = joint_positions(person, motion)[:, [7, 8], 2]
    assert np.abs(ankles.min(axis=1) - person.joints_tpose_m[7, 1]).max() < 0.01


def test_impossible_films_are_refused() -> None:
    with pytest.raises(ConfigError, match="--frames must lie in"):
        AvatarCaptureConfig(frames=3)
    with pytest.raises(ConfigError, match="--size must lie in"):
        AvatarCaptureConfig(width_px=16)
    with pytest.raises(ConfigError, match="--pose-noise-deg"):
        AvatarCaptureConfig(pose_noise_deg=90.0)
    with pytest.raises(ConfigError, match="--keypoint-noise-px must lie in"):
        AvatarCaptureConfig(keypoint_noise_px=-1.0)
    with pytest.raises(ConfigError, match="--body keypoints needs --layout plain"):
        AvatarCaptureConfig(body="keypoints")


def test_keypoints_take_the_place_of_poses(person: Avatar, tmp_path: Path) -> None:
    config = dataclasses.replace(CONFIG, layout="plain", body="keypoints", keypoint_noise_px=0.0)
    capture_avatar(person, tmp_path / "film", config, lambda _: None)
    assert not (tmp_path / "film" / "poses.npz").exists()
    views = read_views(tmp_path / "film")
    keypoints = read_keypoints(tmp_path / "film" / "keypoints.npz", views.images)
    joints = np.load(tmp_path / "film" / "truth.npz")["joints_m"]
    p = np.einsum("fij,fi->fj", views.T_world_camera[:, :3, :3], joints[:, 4] - views.T_world_camera[:, :3, 3])
    expected = p[:, :2] / p[:, 2:] * views.K_px[:, [0, 1], [0, 1]] + views.K_px[:, :2, 2]
    np.testing.assert_allclose(keypoints.uv_px[:, keypoints.column("left_knee")], expected, atol=1e-3)
