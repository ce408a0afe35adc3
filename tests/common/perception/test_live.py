import dataclasses
import math

import numpy as np
import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.messages import EpisodeKey, Split
from readygo.common.messages.codec import decode, encode
from readygo.common.messages.live import LivePerception
from readygo.common.perception import PeopleTracker, Perceived, live_perception
from readygo.common.perception.grid import SHAPE
from readygo.common.perception.live import covariance_ellipse, free_points, place_ahead
from readygo.common.perception.people import CHANNELS
from tests.common.perception.test_tracker import everywhere, seen

CAMERA = CameraConfig()
EPISODE = EpisodeKey(seed=0, split=Split.TEST, index=4)
POSE = (1.0, 2.0, 0.5, math.pi / 2)


def perception() -> LivePerception:
    """A human 3 m ahead of a robot that looks along y, who walks to the robot's left."""
    people = seen((3.0, 0.0, 0.0, 1.0))
    people.place_cov[0] = np.diag([0.04, 0.01])
    tracker = PeopleTracker(None, None, velocities=True)
    tracker.fuse((1.0, 2.0, math.pi / 2), people, everywhere)
    tracker.predict(0.1)
    perceived = Perceived(
        people=people,
        rays_m=np.full(SHAPE[1], 2.0),
        rays_sd=np.full(SHAPE[1], 0.1),
        answers=np.zeros((CHANNELS, *SHAPE)),
    )
    return live_perception(EPISODE, 50_000_000, POSE, perceived, tracker.known, CAMERA)


def test_people_and_their_tracks_are_told_in_the_world() -> None:
    told = perception()
    (human,), (track,) = told.detections, told.tracks
    assert human.xy_m == pytest.approx((1.0, 5.0))
    assert human.v_mps == pytest.approx((-1.0, 0.0))
    assert human.place_cov_m2 == pytest.approx((0.01, 0.0, 0.04))
    assert track.number == 0
    assert track.age_s == pytest.approx(0.1)
    assert 0.5 < track.presence < 1.0
    assert track.xy_m[0] < 1.0
    assert place_ahead(human) == pytest.approx((0.0, 5.0))


def test_ellipse_has_two_standard_deviations() -> None:
    (track,) = perception().tracks
    outline = covariance_ellipse(track)
    np.testing.assert_allclose(outline[:-1].mean(axis=0), track.xy_m, atol=1e-9)
    np.testing.assert_allclose(outline[0], outline[-1])
    wide = dataclasses.replace(track, xy_m=(0.0, 0.0), place_cov_m2=(0.09, 0.0, 0.01))
    assert np.abs(covariance_ellipse(wide)).max(axis=0) == pytest.approx((0.6, 0.2), rel=0.01)


def test_free_distances_end_around_the_camera_from_left_to_right() -> None:
    points = free_points(perception(), CAMERA)
    np.testing.assert_allclose(np.hypot(*(points - [1.0, 2.0]).T), 2.0, rtol=1e-6)
    assert (np.diff(points[:, 0]) > 0).all()
    assert points[:, 1].min() > 2.0


def test_message_travels_and_has_a_direction_for_every_distance() -> None:
    told = perception()
    again = decode(LivePerception, encode(told))
    assert again.detections == told.detections
    assert again.tracks == told.tracks
    assert len(encode(told)) < 2000
    with pytest.raises(ValueError, match="rays_m"):
        LivePerception(
            episode=EPISODE,
            time_ns=0,
            robot_xyzyaw=POSE,
            detections=(),
            tracks=(),
            ray_bearings_rad=np.zeros(3, np.float32),
            rays_m=np.zeros(2, np.float32),
        )
