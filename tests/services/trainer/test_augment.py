import dataclasses
import math

import numpy as np
import pytest
import torch

from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.services.trainer.augment import (
    TurnedCamera,
    correct_for_turn,
    corrupt_previous,
    draw_yaws,
    hindsight_goals,
    shift_frames,
    vary_light,
)
from readygo.services.trainer.samples import build_table


def test_light_varies_alike_within_an_episode():
    images = torch.full((4, 3, 2, 2), 0.25)
    vary_light(images, np.array([7, 9, 7, 9]), 0.3, np.random.default_rng(0))
    assert torch.equal(images[0], images[2])
    assert torch.equal(images[1], images[3])
    assert not torch.equal(images[0], images[1])


def test_no_strength_changes_nothing():
    images = torch.rand(2, 3, 4, 4)
    frames = np.arange(2 * 4 * 4 * 3, dtype=np.uint8).reshape(2, 4, 4, 3)
    before = images.clone()
    vary_light(images, np.zeros(2, np.int64), 0.0, np.random.default_rng(0))
    assert torch.equal(images, before)
    assert np.array_equal(shift_frames(frames, np.zeros(2, np.int64), 0, np.random.default_rng(0)), frames)


def test_shift_moves_a_bright_pixel_by_at_most_the_limit():
    frames = np.zeros((30, 21, 31, 3), np.uint8)
    frames[:, 10, 15] = 255
    shifted = shift_frames(frames, np.arange(30), 3, np.random.default_rng(0))
    places = np.array([np.argwhere(frame[:, :, 0] == 255)[0] for frame in shifted])
    assert set(np.abs(places - (10, 15)).ravel().tolist()) == {0, 1, 2, 3}


def test_shift_repeats_the_edge():
    frames = np.full((1, 8, 8, 3), 200, np.uint8)
    assert np.all(shift_frames(frames, np.zeros(1, np.int64), 3, np.random.default_rng(1)) == 200)


def test_previous_action_is_withheld_as_often_as_asked():
    previous = torch.ones(4000, 2)
    corrupted = corrupt_previous(previous, 0.0, 0.25, np.random.default_rng(0))
    withheld = (corrupted == 0).all(dim=1)
    assert 0.22 < withheld.float().mean() < 0.28
    assert torch.equal(corrupted[~withheld], previous[~withheld])


def test_previous_action_carries_noise():
    corrupted = corrupt_previous(torch.zeros(4000, 2), 0.1, 0.0, np.random.default_rng(0))
    assert 0.095 < corrupted.std() < 0.105


SMALL = CameraConfig(height_px=48, width_px=96)
LENSES = {
    "pinhole": {},
    "pitched": {"mount_pitch_deg": 15.0},
    "barrel": {"distortion": "brown_conrady", "k1": -0.05, "p1": 0.002},
    "fisheye": {"distortion": "fisheye", "k1": 0.02, "mount_pitch_deg": -10.0},
    "calibrated": {"fx_px": 42.0, "fy_px": 40.0, "cx_px": 50.0, "cy_px": 22.0, "horizontal_fov_deg": None},
}


def panorama(camera, yaw_rad):
    """What a camera sees of a world whose brightness is a function of direction alone."""
    rows, columns = np.mgrid[: camera.height_px, : camera.width_px] + 0.5
    xy = make_lens(camera).rays(np.stack([columns.ravel(), rows.ravel()], axis=1))
    rays = np.concatenate([xy, np.ones((len(xy), 1))], axis=1) @ camera.T_world_camera(0, 0, yaw_rad, 0)[:3, :3].T
    heading_rad, rise = np.arctan2(rays[:, 1], rays[:, 0]), rays[:, 2] / np.linalg.norm(rays, axis=1)
    brightness = 128 + 60 * np.sin(5 * heading_rad) + 60 * np.sin(4 * rise)
    return np.repeat(np.rint(brightness).astype(np.uint8).reshape(rows.shape)[:, :, None], 3, axis=2)


@pytest.mark.parametrize("lens", LENSES)
def test_turned_frame_is_what_the_turned_camera_sees(lens):
    camera = dataclasses.replace(SMALL, **LENSES[lens])
    frames = np.stack([panorama(camera, 0.3)] * 3)
    turned = TurnedCamera(camera).turn(frames, np.array([0.2, -0.2, 0.2]))
    left = np.abs(turned[0].astype(int) - panorama(camera, 0.5))[10:-10, 25:]
    right = np.abs(turned[1].astype(int) - panorama(camera, 0.1))[10:-10, :-25]
    assert left.max() <= 3
    assert right.max() <= 3
    assert np.array_equal(turned[0], turned[2])


def test_lens_matters_to_the_turn():
    camera = dataclasses.replace(SMALL, distortion="brown_conrady", k1=-0.05)
    turned = TurnedCamera(SMALL).turn(panorama(camera, 0.3)[None], np.array([0.2]))[0]
    assert np.abs(turned.astype(int) - panorama(camera, 0.5))[10:-10, 25:].max() > 3


@pytest.mark.parametrize("optics", [{}, {"distortion": "fisheye", "horizontal_fov_deg": 150.0}])
def test_beyond_the_frame_its_edge_is_repeated(optics):
    camera = dataclasses.replace(SMALL, **optics)
    frame = np.zeros((48, 96, 3), np.uint8)
    frame[:, 0] = 200
    turned = TurnedCamera(camera).turn(frame[None], np.array([0.25]))[0]
    assert (turned[24, :6] == 200).all()
    assert (turned[24, 40:] == 0).all()


def test_unturned_frame_is_unchanged():
    frames = panorama(SMALL, 0.3)[None]
    assert np.array_equal(TurnedCamera(SMALL).turn(frames, np.zeros(1)), frames)


def test_robot_turned_left_sees_its_goal_on_the_right_and_turns_back():
    actions, goals = correct_for_turn(
        torch.tensor([[0.8, 0.1], [0.8, 1.1]]),
        torch.tensor([[2.0, 0.0], [2.0, 0.0]]),
        torch.tensor([math.pi / 2, -0.3]),
        0.5,
        1.2,
    )
    assert torch.allclose(goals[0], torch.tensor([0.0, -2.0]), atol=1e-6)
    assert torch.allclose(actions, torch.tensor([[0.8, 0.1 - math.pi / 4], [0.8, 1.2]]))


def test_yaw_errors_are_alike_within_an_episode_and_bounded():
    yaws_rad = draw_yaws(np.repeat(np.arange(3000), 2), 0.1, np.random.default_rng(0))
    assert np.array_equal(yaws_rad[::2], yaws_rad[1::2])
    assert 0.09 < yaws_rad.std() < 0.1
    assert np.abs(yaws_rad).max() <= 0.25


def test_hindsight_goal_is_a_place_that_the_robot_reached_later_in_its_episode(make_data):
    source = make_data(episodes=3, samples=40)
    source.poses[:, 0] = np.tile(np.arange(40) * 0.19, 3)
    source.poses[:, 1] = np.repeat([0.0, 100.0, 200.0], 40)
    source.poses[:, 3] = np.pi / 2
    table = build_table(source)
    samples = np.arange(120)
    goals = hindsight_goals(table, samples, 1.0, np.random.default_rng(0))
    replaced = np.any(goals != source.goals_xy_m, axis=1)
    # Facing +y and driving along +x, whatever comes later is to the right.
    np.testing.assert_allclose(goals[replaced, 0], 0.0, atol=1e-5)
    steps_later = -goals[replaced, 1] / 0.19
    np.testing.assert_allclose(steps_later, np.round(steps_later), atol=1e-4)
    assert np.all(steps_later <= (table.last - samples)[replaced] + 1e-4)
    assert np.all(-goals[replaced, 1] > 1.0)
    assert not replaced[(table.last - samples) * 0.19 <= 1.0].any()


def test_hindsight_share_zero_keeps_every_goal(make_data):
    source = make_data()
    samples = np.arange(60)
    goals = hindsight_goals(build_table(source), samples, 0.0, np.random.default_rng(0))
    np.testing.assert_array_equal(goals, source.goals_xy_m[samples])
