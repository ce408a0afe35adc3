import dataclasses
import math

import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.common.policy.motion import own_motion
from readygo.common.robot import RobotConfig
from readygo.services.trainer.augment import (
    RobotWarp,
    View,
    correct_for_turn,
    corrupt_previous,
    draw_light,
    draw_views,
    hindsight_goals,
    in_mirror,
    light_on,
    lit,
    mirror_twins,
    mirrored_motion,
    plain_view,
    show_frames,
    turn_motion,
    turn_world,
)
from readygo.services.trainer.config import SamplingConfig
from readygo.services.trainer.frames import pool
from readygo.services.trainer.samples import Timing, episode_table, join_tables
from tests.services.trainer.conftest import make_one


def view_of(yaws_rad=(0.0,), shift_px=(0, 0), mirrored=False):
    count = len(yaws_rad)
    return View(
        yaws_rad=np.array(yaws_rad),
        shifts_px=np.tile(np.array(shift_px), (count, 1)),
        mirrored=np.full(count, mirrored),
        light=draw_light(count, 0.0, np.random.default_rng(0)),
    )


def turn(camera, frames, yaws_rad, pooling=1):
    warps = dict.fromkeys(range(len(frames)), warp_of(camera, pooling))
    return show_frames(frames, np.arange(len(frames)), view_of(yaws_rad), warps)


def warp_of(camera, pooling=1):
    return RobotWarp(RobotConfig(camera=camera), ("rgb",), pooling)


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
    turned = turn(camera, frames, [0.2, -0.2, 0.2])
    left = np.abs(turned[0].astype(int) - panorama(camera, 0.5))[10:-10, 25:]
    right = np.abs(turned[1].astype(int) - panorama(camera, 0.1))[10:-10, :-25]
    assert left.max() <= 3
    assert right.max() <= 3
    assert np.array_equal(turned[0], turned[2])


def test_lens_matters_to_the_turn():
    camera = dataclasses.replace(SMALL, distortion="brown_conrady", k1=-0.05)
    turned = turn(SMALL, panorama(camera, 0.3)[None], [0.2])[0]
    assert np.abs(turned.astype(int) - panorama(camera, 0.5))[10:-10, 25:].max() > 3


@pytest.mark.parametrize("optics", [{}, {"distortion": "fisheye", "horizontal_fov_deg": 150.0}])
def test_beyond_the_frame_its_edge_is_repeated(optics):
    camera = dataclasses.replace(SMALL, **optics)
    frame = np.zeros((48, 96, 3), np.uint8)
    frame[:, 0] = 200
    turned = turn(camera, frame[None], [0.25])[0]
    assert (turned[24, :6] == 200).all()
    assert (turned[24, 40:] == 0).all()


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_pooled_frame_turns_as_the_camera_does(lens):
    camera = dataclasses.replace(SMALL, **LENSES[lens])
    pooled = pool(panorama(camera, 0.3), 2)
    turned = turn(camera, pooled[None], [0.2], pooling=2)[0]
    assert np.abs(turned.astype(int) - pool(panorama(camera, 0.5), 2))[5:-5, 14:].max() <= 3


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_turned_frame_is_shifted_and_mirrored_as_a_plain_one(lens):
    camera = dataclasses.replace(SMALL, **LENSES[lens])
    frames, groups, warp = panorama(camera, 0.3)[None], np.zeros(1, np.int64), {0: warp_of(camera)}
    turned = show_frames(frames, groups, view_of([0.1]), warp)
    expected = show_frames(turned, groups, view_of([0.0], (2, -3), mirrored=True), warp)
    both = show_frames(frames, groups, view_of([0.1], (2, -3), mirrored=True), warp)
    assert np.abs(both.astype(int) - expected)[0, 8:-8, 12:-12].max() <= 3


def test_plain_view_changes_nothing():
    frames = panorama(SMALL, 0.3)[None]
    assert show_frames(frames, np.zeros(1, np.int64), plain_view(), {0: warp_of(SMALL)}) is frames


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("shift_px", [(0, 0), (2, 3), (-2, 1), (1, -3), (-1, -1)])
def test_shift_moves_the_image_repeats_its_edge_and_is_mirrored_then(shift_px, mirrored):
    frame = np.random.default_rng(0).integers(0, 256, (48, 96, 3), np.uint8)
    shown = show_frames(frame[None], np.zeros(1, np.int64), view_of([0.0], shift_px, mirrored), {0: warp_of(SMALL)})[0]
    rows = np.clip(np.arange(48) - shift_px[0], 0, 47)
    columns = np.clip(np.arange(96) - shift_px[1], 0, 95)
    expected = frame[rows][:, columns]
    assert np.array_equal(shown, expected[:, ::-1] if mirrored else expected)


def test_light_varies_between_groups_and_none_keeps_the_image():
    light = draw_light(2, 0.3, np.random.default_rng(0))
    frames = np.full((3, 2, 2, 3), 160, np.uint8)
    shown = lit(frames, np.array([0, 1, 0]), light)
    assert np.array_equal(shown[0], shown[2])
    assert not np.array_equal(shown[0], shown[1])
    plain = lit(
        np.array([0, 255], np.uint8).reshape(1, 2, 1, 1).repeat(3, axis=3), np.zeros(1, int), plain_view().light
    )
    assert plain[0, :, 0].tolist() == [[-1.0] * 3, [1.0] * 3]


def test_tables_of_sixteen_bits_stay_so():
    light = np.arange(256 * 3, dtype=np.int16).reshape(1, 256, 3)
    shown = lit(np.full((1, 1, 1, 3), 7, np.uint8), np.zeros(1, np.int64), light)
    assert shown.dtype == np.int16
    assert shown.ravel().tolist() == [21, 22, 23]


def test_views_are_as_wide_as_asked_for_and_turn_only_who_may_be_turned():
    config = SamplingConfig(yaw_error_rad=0.1, shift_px=3, mirror=0.25)
    turnable = np.arange(4000) % 2 == 0
    view = draw_views(turnable, config, np.random.default_rng(0))
    assert not view.yaws_rad[~turnable].any()
    assert 0.09 < view.yaws_rad[turnable].std() < 0.1
    assert np.abs(view.yaws_rad).max() <= 0.25
    assert (view.shifts_px.min(), view.shifts_px.max()) == (-3, 3)
    assert 0.22 < view.mirrored.mean() < 0.28


def test_camera_that_is_not_its_own_mirror_image_is_known():
    def is_symmetric(camera):
        return in_mirror(camera) == camera

    assert is_symmetric(CameraConfig(mount_pitch_deg=10.0, mount_x_m=0.2))
    assert is_symmetric(CameraConfig(mount_yaw_deg=180.0))
    assert not is_symmetric(CameraConfig(mount_y_m=0.1))
    assert not is_symmetric(CameraConfig(mount_yaw_deg=30.0))
    assert not is_symmetric(CameraConfig(distortion="brown_conrady", p2=0.001))
    focal = {"fx_px": 100.0, "fy_px": 100.0, "cy_px": 72.0, "horizontal_fov_deg": None}
    assert is_symmetric(CameraConfig(cx_px=128.0, **focal))
    assert not is_symmetric(CameraConfig(cx_px=120.0, **focal))


def three_cameras():
    sides = {
        name: dataclasses.replace(SMALL, mount_y_m=0.1 * side, mount_yaw_deg=60.0 * side)
        for name, side in (("left", 1), ("right", -1))
    }
    return RobotConfig(camera=SMALL, cameras=sides)


def test_cameras_of_both_sides_are_twins_and_one_alone_has_none():
    assert mirror_twins(three_cameras(), ("", "left", "right")) == {"": "", "left": "right", "right": "left"}
    assert mirror_twins(three_cameras(), ("", "left")) is None


def test_mirrored_robot_sees_to_its_left_what_it_saw_to_its_right():
    images = ("rgb", "left.rgb", "right.rgb")
    warp = RobotWarp(three_cameras(), images)
    frames = np.random.default_rng(0).integers(0, 256, (2, SMALL.height_px, SMALL.width_px, 9), np.uint8)
    view = dataclasses.replace(view_of([0.0, 0.0]), mirrored=np.array([False, True]))
    shown = show_frames(frames, np.arange(2), view, {0: warp, 1: warp})
    assert np.array_equal(shown[0], frames[0])
    assert np.array_equal(shown[1, ..., 3:6], frames[1, :, ::-1, 6:9])
    assert np.array_equal(shown[1, ..., :3], frames[1, :, ::-1, :3])


def test_light_falls_on_colours_of_all_cameras_alone():
    light = draw_light(2, 0.3, np.random.default_rng(0))
    tables = light_on(light, ("rgb", "depth", "left.rgb"))
    assert np.array_equal(tables[..., 4:], light)
    assert np.allclose(tables[..., 3], np.arange(256) / 127.5 - 1)


def test_robot_turned_left_sees_its_goal_on_the_right_and_turns_back():
    yaws_rad = np.array([math.pi / 2, -0.3, 0.0])
    goals = turn_world(np.array([[2.0, 0.0]] * 3, np.float32), yaws_rad)
    commands = np.array([[0.8, 0.1], [0.8, 1.1], [0.8, 1.5]], np.float32)
    assert np.allclose(goals[0], [0.0, -2.0], atol=1e-6)
    corrected = correct_for_turn(commands, yaws_rad, 0.5, 1.2)
    assert np.allclose(corrected, [[0.8, 0.1 - math.pi / 4], [0.8, 1.2], [0.8, 1.5]])


POSES = np.array([[[-1.0, 0.2, 0.3], [-0.5, 0.1, 0.2]]])
COMMAND = np.array([[0.5, 0.1]], np.float32)


def test_own_motion_of_a_turned_robot_is_that_of_turned_poses():
    present = np.array([[0.2, 0.3, 0.4]])
    yaw = np.array([0.0, 0.0, 0.25])
    turned = turn_motion(own_motion(POSES, present, COMMAND), np.array([0.25]))
    assert np.allclose(turned, own_motion(POSES + yaw, present + yaw, COMMAND), atol=1e-6)


def test_mirrored_motion_is_that_of_mirrored_poses_and_commands():
    present, flip = np.array([[0.2, 0.3, 0.4]]), np.array([1.0, -1.0, -1.0])
    mirrored = own_motion(POSES * flip, present * flip, COMMAND * np.array([1, -1], np.float32))
    assert np.allclose(own_motion(POSES, present, COMMAND) * mirrored_motion(8), mirrored, atol=1e-6)


def test_withheld_previous_action_differs_from_standing_still():
    commands = np.array([[0.5, 0.2], [0.0, 0.0], [0.5, 0.2]], np.float32)
    corrupted = corrupt_previous(commands, np.full((3, 2), 0.1, np.float32), np.array([False, False, True]))
    assert np.allclose(corrupted, [[0.6, 0.3, 1], [0.1, 0.1, 1], [0, 0, 0]])


def straight_drives(**fields):
    """Episodes that drive along +x while they look along +y."""
    tables = []
    for k in range(3):
        xyyaw = np.stack([np.arange(40) * 0.19, np.full(40, 100.0 * k), np.full(40, np.pi / 2)], axis=1)
        tables.append(episode_table(make_one(f"e{k}", xyyaw=xyyaw, **fields), RobotConfig(), Timing(spacing_steps=10)))
    return join_tables(tables)


def test_hindsight_goal_is_a_place_that_the_robot_reached_later_in_its_episode():
    table, samples = straight_drives(), np.arange(120)
    goals = hindsight_goals(table, samples, 1.0, np.random.default_rng(0)).xy_m
    replaced = np.any(goals != table.goals_xy_m, axis=1)
    # Whatever comes later is to the right.
    np.testing.assert_allclose(goals[replaced, 0], 0.0, atol=1e-5)
    steps_later = -goals[replaced, 1] / 0.19
    np.testing.assert_allclose(steps_later, np.round(steps_later), atol=1e-4)
    assert np.all(steps_later <= (table.last - samples)[replaced] + 1e-4)
    assert np.all(-goals[replaced, 1] > 1.0)
    assert not replaced[(table.last - samples) * 0.19 <= 1.0].any()


def test_hindsight_goals_end_where_the_expert_was_disturbed():
    calm = make_one("e0")
    expert = np.repeat(calm.actions[:, None], 2, axis=1)
    expert[20, 0] += 0.3
    xyyaw = np.stack([np.arange(40) * 0.19, np.zeros(40), np.full(40, np.pi / 2)], axis=1)
    table = episode_table(
        dataclasses.replace(calm, xyyaw=xyyaw, expert=expert), RobotConfig(), Timing(spacing_steps=10)
    )
    samples = np.arange(40)
    for seed in range(20):
        goals = hindsight_goals(table, samples, 1.0, np.random.default_rng(seed)).xy_m
        replaced = np.any(goals != table.goals_xy_m, axis=1)
        reached = np.round(-goals[:, 1] / 0.19) + samples
        assert not replaced[20]
        assert np.all(reached[:20][replaced[:20]] <= 20)


def test_hindsight_share_zero_keeps_every_goal():
    table = straight_drives()
    goals = hindsight_goals(table, np.arange(60), 0.0, np.random.default_rng(0)).xy_m
    np.testing.assert_array_equal(goals, table.goals_xy_m[:60])
