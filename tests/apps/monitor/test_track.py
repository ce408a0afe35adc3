import dataclasses
import math

import numpy as np
import pytest

from readygo.apps.monitor.track import between, on_floor, time_text, track_of
from readygo.common.fleet.shown import state_of
from readygo.common.messages import CommittedEpisode
from readygo.common.robot import RobotConfig
from tests.common.dataset.episodes import LEFT, make_episode, with_left_camera

TWO_CAMERAS = RobotConfig(cameras={"left": LEFT})


def recorded(index: int = 0, count: int = 12) -> CommittedEpisode:
    header, samples = make_episode(index, count)
    return CommittedEpisode(header=header, attempt=1, samples=samples)


def recorded_by_two(count: int = 12) -> CommittedEpisode:
    """An episode of `TWO_CAMERAS`."""
    header, samples = with_left_camera(*make_episode(0, count))
    return CommittedEpisode(header=header, attempt=1, samples=samples)


def test_track_has_every_sample_and_its_image() -> None:
    committed = recorded()
    track = track_of(committed)
    assert track.duration_s == committed.samples[-1].time_ns / 1e9
    assert track.at(0.0).robot_xyzyaw == committed.samples[0].robot_xyzyaw
    assert track.at(1e9).sample == 11
    assert track.images_at(0.0) == {"rgb": committed.samples[0].image}
    assert track.images_at(committed.samples[5].time_ns / 1e9) == {"rgb": committed.samples[5].image}
    assert len(track.replans) == sum(sample.replanned for sample in committed.samples)
    assert track.way.shape == (12, 3)


def test_track_has_the_images_of_all_cameras() -> None:
    committed = recorded_by_two()
    images = track_of(committed).images_at(0.0)
    assert list(images) == ["rgb", "left.rgb", "left.depth"]
    assert images["left.rgb"] == committed.samples[0].outputs["left.rgb"]


def test_between_two_moments_everybody_is_on_the_way() -> None:
    header, samples = make_episode(0, 2)
    a, b = (state_of(header, sample) for sample in samples)
    a = dataclasses.replace(a, robot_xyzyaw=(0.0, 0.0, 0.0, math.pi - 0.1), humans_xyzyaw=((0.0, 0.0, 0.0, 0.0),))
    b = dataclasses.replace(b, robot_xyzyaw=(1.0, 0.0, 0.0, 0.1 - math.pi), humans_xyzyaw=((2.0, 0.0, 0.0, 0.0),))
    x, _, _, yaw = between(a, b, 0.5).robot_xyzyaw
    assert x == 0.5
    assert math.cos(yaw) == pytest.approx(-1.0), "the short way round"
    assert between(a, b, 0.5).humans_xyzyaw[0][0] == 1.0
    assert between(a, b, -1.0) is a
    assert between(a, b, 2.0) is b
    assert between(a, dataclasses.replace(b, humans_xyzyaw=()), 0.5) is a


def test_texts_and_floors() -> None:
    assert time_text(math.inf) == "never"
    assert time_text(1.25) == "1.2 s"
    assert on_floor(np.zeros((3, 2), np.float32), 0.5)[:, 2].tolist() == [0.5] * 3


def test_state_of_a_time_lies_between_its_neighbours_and_images_are_the_newest() -> None:
    track = track_of(recorded(count=4))
    times_s = [state.time_ns / 1e9 for state in track.states]
    first, second = track.states[1], track.states[2]
    found = track.at(times_s[1] + 0.3 * (times_s[2] - times_s[1]))
    want = between(first, second, 0.3)
    assert found.robot_xyzyaw == pytest.approx(want.robot_xyzyaw)
    assert found.time_ns == pytest.approx(want.time_ns, abs=1)
    assert found.sample == 1
    assert track.at(times_s[2]) == second
    assert track.at(times_s[0] - 1.0) == track.states[0]
    before = times_s[2] - 2e-9
    assert track.images_at(before) == {"rgb": track.images[1][1]["rgb"]}
    assert track.images_at(times_s[2] - 1e-9) == track.images[2][1]
    assert track.images_at(-1.0) == track.images[0][1]
    assert dataclasses.replace(track, images=()).images_at(1.0) == {}
    assert track.way.tolist() == [list(state.robot_xyzyaw[:3]) for state in track.states]


def test_replans_are_where_the_robot_was() -> None:
    committed = recorded(count=4)
    samples = tuple(
        dataclasses.replace(one, replanned=k in (1, 3), robot_xyzyaw=(k + 0.5, -2.0 * k, 0.3, 2.5))
        for k, one in enumerate(committed.samples)
    )
    track = track_of(dataclasses.replace(committed, samples=samples))
    assert track.replans.tolist() == [[1.5, -2.0, 0.3], [3.5, -6.0, 0.3]]
    assert (track.outcome, track.image_format) == (committed.header.outcome, committed.header.image_format)
