from types import SimpleNamespace

import numpy as np

from readygo.common.camera.config import CameraConfig
from readygo.common.maps import GridFrame, OccupancyMap, sight_of_occupancy
from readygo.common.robot import Clock
from readygo.services.trainer.perception.looks import grey_of, held_out, image_bytes, joined, looks_of
from tests.services.trainer.perception.conftest import make_looks


def test_grey_is_the_rounded_mean_of_the_colours() -> None:
    frames = np.array([[[[0, 0, 2], [10, 11, 12], [255, 255, 255]]]], np.uint8)
    assert grey_of(frames).tolist() == [[[1, 11, 255]]]


def test_joined_looks_keep_their_windows_and_episodes() -> None:
    first, second = make_looks(12, episodes=3), make_looks(9, episodes=2, seed=1)
    both = joined([first, second])
    assert len(both) == 21
    np.testing.assert_array_equal(both.frames[both.window[12:]], second.frames[second.window])
    assert sorted(set(both.episode[12:].tolist())) == [3, 4]
    np.testing.assert_array_equal(both.labels.people[12:], second.labels.people)


def test_whole_episodes_are_held_out_the_same_ones_for_a_seed() -> None:
    looks = make_looks(60, episodes=10)
    chosen = held_out(looks, 0.2, seed=3)
    assert len(set(looks.episode[chosen].tolist())) == 2
    assert not set(looks.episode[chosen].tolist()) & set(looks.episode[~chosen].tolist())
    np.testing.assert_array_equal(chosen, held_out(looks, 0.2, seed=3))
    assert not held_out(looks, 0.0, seed=3).any()


class Recorded:
    """Four episodes of three images; a sample's image is all of its number."""

    def __init__(self) -> None:
        self.episodes = [SimpleNamespace(first_sample=3 * k, sample_count=3) for k in range(4)]
        self.episode_of_sample = np.repeat(np.arange(4), 3)
        self.pictured = np.ones(12, np.bool_)
        self.time_ns = 200_000_000 * np.arange(12)
        self.poses = np.tile([2.0, 2.0, 0.0, 0.0], (12, 1))
        self.actions = np.zeros((12, 2), np.float32)
        self.humans_xyzyaw = tuple(np.zeros((0, 4)) for _ in range(12))
        self.clock = Clock()

    def decode(self, index: int) -> np.ndarray:
        return np.full((144, 256, 3), index, np.uint8)


def test_share_of_the_episodes_is_spread_evenly_and_windows_stay_within_them() -> None:
    occupancy = OccupancyMap(
        frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1), occupied=np.zeros((40, 40), np.bool_)
    )
    camera, sight = CameraConfig(), sight_of_occupancy(occupancy)
    for share, samples in ((1.0, range(12)), (0.5, [3, 4, 5, 9, 10, 11])):
        looks = looks_of(Recorded(), camera, occupancy, sight, 0.2, share=share)  # type: ignore[arg-type]
        assert looks.frames[:, 0, 0, 0].tolist() == [*samples]
        assert looks.frames.shape[1:] == (72, 128, 3)
        a, b, c = samples[:3]
        assert looks.frames[looks.window, 0, 0, 0][:3].tolist() == [[a, a, a], [a, a, b], [a, b, c]]
    assert image_bytes(camera) == 4 * 72 * 128
