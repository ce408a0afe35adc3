from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.maps import FloorMap, GridFrame
from readygo.common.messages import EpisodeKey, HumanMotion, Motion, Split
from readygo.common.robot import RobotConfig, step_unicycle
from readygo.services.renderer import Shot, calibrations, path_poses
from readygo.services.renderer.camera import (
    TIME_ONE,
    EpisodeCamera,
    arc,
    exposure_gain,
    make_shutter,
    sensor_key,
    sensor_rng,
)

HEIGHT = 48


def camera(**times: float) -> CameraConfig:
    return CameraConfig(height_px=HEIGHT, **times)


@pytest.mark.parametrize(
    ("exposure_s", "readout_s", "sub_frames"),
    [(0.02, 0.0, 8), (0.0, 0.02, 5), (0.01, 0.015, 7), (0.05, 0.05, 64), (1e-9, 0.02, 8), (0.004, 0.02, 4)],
)
def test_every_row_gets_all_its_light_before_the_frames_own_time(
    exposure_s: float, readout_s: float, sub_frames: int
) -> None:
    shutter = make_shutter(camera(exposure_s=exposure_s, readout_s=readout_s), sub_frames)
    assert shutter.weight.shape == (sub_frames, HEIGHT)
    assert (shutter.weight >= 0).all()
    assert (shutter.weight.sum(axis=0) == TIME_ONE).all()
    assert max(shutter.steps) < 0
    assert shutter.steps == tuple(sorted(shutter.steps))


def test_row_is_exposed_at_its_own_time_for_the_exposure() -> None:
    shutter = make_shutter(camera(exposure_s=0.01, readout_s=0.02), 64)
    times_s = np.array(shutter.steps) * 0.05
    for row in (0, 20, HEIGHT - 1):
        end_s = 0.02 * row / (HEIGHT - 1) - 0.02
        share = shutter.weight[:, row] / TIME_ONE
        assert share @ times_s == pytest.approx(end_s - 0.005, abs=2e-4)
        assert times_s[share > 0].min() >= end_s - 0.01 - 5e-4
        assert times_s[share > 0].max() <= end_s + 5e-4
        assert times_s[shutter.middle[row]] == pytest.approx(end_s - 0.005, abs=5e-4)


def test_closed_ends_need_one_image_only() -> None:
    shutter = make_shutter(camera(exposure_ev=1.0), 8)
    assert shutter.steps == (0.0,)
    assert (shutter.weight == TIME_ONE).all()


def test_without_readout_all_rows_are_alike() -> None:
    shutter = make_shutter(camera(exposure_s=0.02), 8)
    assert (shutter.weight == TIME_ONE // 8).all()


def test_shutters_are_as_they_were(golden_figures) -> None:
    for exposure_s, readout_s, sub_frames in ((0.013, 0.021, 7), (0.04, 0.0, 5), (0.0, 0.033, 9)):
        shutter = make_shutter(camera(exposure_s=exposure_s, readout_s=readout_s), sub_frames)
        golden_figures(f"sensor/shutter {sub_frames}", np.array(shutter.steps), shutter.weight / TIME_ONE)
        golden_figures(f"sensor/middles {sub_frames}", shutter.middle)


@given(st.floats(-3, 3), st.floats(-0.99, 0.99), st.floats(-1.5, 1.5), st.floats(0, 1), st.floats(-3.0, 3.0))
def test_robot_drives_the_unicycles_arc_between_rows(x: float, v: float, w: float, share: float, yaw: float) -> None:
    first = np.array([x, 0.4, yaw])
    last = np.array(step_unicycle(*first, v, w, 0.05))
    expected = step_unicycle(*first, v, w, 0.05 * share)
    # The ends of arcs of many kilometres cancel.
    assert arc(first, last, share) == pytest.approx(expected, abs=1e-9 if abs(w) > 1e-6 else 1e-6)


def episode_camera(config: CameraConfig, sub_frames: int = 4) -> EpisodeCamera:
    shutter = make_shutter(config, sub_frames)
    return EpisodeCamera(name="", config=config, shutter=shutter, gain=exposure_gain(config), key=(1, 2))


def test_camera_follows_the_floor() -> None:
    heights = np.array([[0.0, 1.0], [0.0, 1.0]], dtype=np.float32)
    floor = FloorMap(frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=1.0), height_m=heights)
    rows = np.array([[0.5, 0.5, 0.0], [1.5, 0.5, 0.0]])
    pose_at, at = path_poses(rows, floor), episode_camera(CameraConfig())
    assert pose_at(at, 0.25)[:3, 3] == pytest.approx((0.75, 0.5, 0.75))
    assert np.array_equal(pose_at(at, -1.0), pose_at(at, 0.0))
    assert np.array_equal(pose_at(at, 7.0), pose_at(at, 1.0))
    assert not np.array_equal(pose_at(at, 0.5), pose_at(at, 1.0))


FLAT = FloorMap(
    frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=1.0), height_m=np.zeros((1, 1), np.float32)
)


def test_path_that_begins_later_is_the_same_from_there_on() -> None:
    rows, at = np.random.default_rng(0).uniform(0, 1, (9, 3)), episode_camera(CameraConfig())
    whole, part = path_poses(rows, FLAT), path_poses(rows[5:8], FLAT, 5)
    for step in (5.0, 5.3, 6.99, 7.0):
        assert np.array_equal(part(at, step), whole(at, step))
    assert np.array_equal(part(at, 4.7), whole(at, 5.0))


def test_sub_frames_have_the_times_and_rows_of_the_shutter_and_those_of_a_standing_robot_are_one() -> None:
    at = episode_camera(camera(exposure_s=0.02, readout_s=0.02))
    rows = np.random.default_rng(0).uniform(0, 1, (9, 3))
    pose = np.random.default_rng(1).uniform(-1, 1, (9, 24, 3)).astype(np.float32)
    human = HumanMotion(avatar="a", motion=Motion(root_m=pose[:, 0], pose_axis_angle=pose))
    shot = Shot(step=5, pose_at=path_poses(rows, FLAT), humans=(human,))
    sub_frames = at.sub_frames(shot)
    assert len(sub_frames) == 4
    for after, weight, one in zip(at.shutter.steps, at.shutter.weight, sub_frames, strict=True):
        assert np.array_equal(one.T_world_camera, shot.pose_at(at, 5 + after))
        assert np.array_equal(one.weight, weight)
    assert sum(one.rows.astype(int) for one in sub_frames).tolist() == [1] * HEIGHT
    for still in (replace(shot, still=True), replace(shot, pose_at=path_poses(rows[:1], FLAT), humans=())):
        (one,) = at.sub_frames(still)
        assert (one.weight == TIME_ONE).all()
        assert one.rows.all()
    walking = at.sub_frames(replace(shot, pose_at=path_poses(rows[:1], FLAT)))
    assert len(walking) == 4
    assert np.array_equal(at.sub_frames(replace(shot, still=True))[0].humans[0].root_m, pose[5, 0])


def numbers(generator: np.random.Generator) -> list[float]:
    return generator.random(4).tolist()


def key(index: int, split: Split = Split.TRAIN, seed: int = 1) -> EpisodeKey:
    return EpisodeKey(seed=seed, split=split, index=index)


def test_stream_is_a_function_of_the_episode_and_the_frame() -> None:
    one, again = (sensor_key(key(3)) for _ in range(2))
    assert one == again
    assert numbers(sensor_rng(one, 7)) == numbers(sensor_rng(again, 7)) == numbers(sensor_rng(one, 7))


def test_draws_and_frames_and_episodes_have_numbers_of_their_own() -> None:
    keys = [sensor_key(k) for k in (key(0), key(1), key(0, Split.TEST), key(0, seed=2), "", "a", "b")]
    keys += [sensor_key(key(0), "left"), sensor_key(key(0), "rear")]
    found = [tuple(numbers(sensor_rng(one))) for one in keys]
    found += [tuple(numbers(sensor_rng(one, step))) for one in keys for step in range(3)]
    assert len(set(found)) == len(found)


EPISODES = [EpisodeKey(seed=0, split=Split.TRAIN, index=index) for index in range(2)]
LEFT = CameraConfig(distortion="brown_conrady", k1=-0.1, k2=0.02, p1=0.01, p2=0.03, k3=0.04)


def test_lenses_have_the_names_and_coefficients_of_foxglove() -> None:
    wide = CameraConfig(height_px=24, width_px=40, distortion="fisheye", k1=0.1, k4=0.01)
    robot = RobotConfig(camera=wide, cameras={"left": LEFT, "rear": CameraConfig()})
    first, left, rear = calibrations(robot, SensorConfig(), EPISODES[0])
    assert (first.name, first.height_px, first.width_px) == ("", 24, 40)
    assert (first.distortion_model, first.distortion) == ("kannala_brandt", (0.1, 0.0, 0.0, 0.01))
    assert (left.name, left.distortion_model, left.distortion) == ("left", "plumb_bob", (-0.1, 0.02, 0.01, 0.03, 0.04))
    assert (rear.distortion_model, rear.distortion) == ("", ())
    assert first.K_px == tuple(wide.K_px.ravel())


def test_each_camera_of_each_episode_draws_a_lens_of_its_own() -> None:
    robot, sensor = RobotConfig(camera=LEFT, cameras={"left": LEFT}), SensorConfig(k1=(-0.2, 0.0))
    drawn = [camera.distortion[0] for episode in EPISODES for camera in calibrations(robot, sensor, episode)]
    assert len(set(drawn)) == 4
    assert all(-0.2 <= k1 <= 0.0 for k1 in drawn)
