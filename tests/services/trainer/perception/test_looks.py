from types import SimpleNamespace
from typing import Any

import numpy as np

from readygo.common.camera.config import CameraConfig
from readygo.common.maps import GridFrame, OccupancyMap, sight_of_occupancy
from readygo.common.robot import Clock
from readygo.services.trainer.perception.looks import RecordedScene, grey_of, held_out, image_bytes, looks_of
from tests.services.trainer.perception.conftest import make_looks


def test_grey_is_the_rounded_mean_of_the_colours() -> None:
    frames = np.array([[[[0, 0, 2], [10, 11, 12], [255, 255, 255]]]], np.uint8)
    assert grey_of(frames).tolist() == [[[1, 11, 255]]]


def test_whole_episodes_are_held_out_the_same_ones_for_a_seed() -> None:
    looks = make_looks(60, episodes=10)
    chosen = held_out(looks, 0.2, seed=3)
    assert len(set(looks.episode[chosen].tolist())) == 2
    assert not set(looks.episode[chosen].tolist()) & set(looks.episode[~chosen].tolist())
    np.testing.assert_array_equal(chosen, held_out(looks, 0.2, seed=3))
    assert not held_out(looks, 0.0, seed=3).any()


class Recorded:
    """Four episodes of three images; a sample's image is all of its number, from `first` on."""

    def __init__(self, first: int = 0) -> None:
        self.episodes = [SimpleNamespace(first_sample=3 * k, sample_count=3) for k in range(4)]
        self.episode_of_sample = np.repeat(np.arange(4), 3)
        self.pictured = np.ones(12, np.bool_)
        self.time_ns = 200_000_000 * np.arange(12)
        self.poses = np.tile([2.0 + first, 2.0, 0.0, 0.0], (12, 1))
        self.actions = np.full((12, 2), first, np.float32)
        self.humans_xyzyaw = tuple(np.zeros((0, 4)) for _ in range(12))
        self.clock = Clock()
        self._first = first

    def decode(self, index: int) -> np.ndarray:
        return np.full((144, 256, 3), self._first + index, np.uint8)


def of_scene(*, first: int = 0, width_m: float = 4.0) -> RecordedScene:
    occupancy = OccupancyMap(
        frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1),
        occupied=np.zeros((40, round(10 * width_m)), np.bool_),
    )
    dataset: Any = Recorded(first)
    return RecordedScene(dataset=dataset, blocked=occupancy, sight=sight_of_occupancy(occupancy))


def test_share_of_the_episodes_is_spread_evenly_and_windows_stay_within_them() -> None:
    for share, samples in ((1.0, range(12)), (0.5, [3, 4, 5, 9, 10, 11])):
        looks = looks_of([of_scene()], CameraConfig(), 0.2, share=share)
        assert looks.frames[:, 0, 0, 0].tolist() == [*samples]
        assert looks.frames.shape[1:] == (72, 128, 3)
        a, b, c = samples[:3]
        assert looks.frames[looks.window, 0, 0, 0][:3].tolist() == [[a, a, a], [a, a, b], [a, b, c]]
    assert image_bytes(CameraConfig()) == looks.frames[0].nbytes == 3 * 72 * 128


def test_images_of_several_scenes_keep_their_windows_episodes_motion_and_maps() -> None:
    both = looks_of([of_scene(), of_scene(first=100, width_m=3.0)], CameraConfig(), 0.2, share=0.5)
    one, other = (
        looks_of([part], CameraConfig(), 0.2, share=0.5) for part in (of_scene(), of_scene(first=100, width_m=3.0))
    )
    assert both.frames[both.window[6:], 0, 0, 0].tolist() == other.frames[other.window, 0, 0, 0].tolist()
    assert both.frames[both.window[6], 0, 0, 0].tolist() == [103, 103, 103]
    assert both.episode.tolist() == 3 * [1] + 3 * [3] + 3 * [5] + 3 * [7]
    np.testing.assert_array_equal(both.motion, np.concatenate([one.motion, other.motion]))
    assert both.motion[7, -1] == 100.0
    np.testing.assert_array_equal(both.labels.rays_m, np.concatenate([one.labels.rays_m, other.labels.rays_m]))
    assert both.labels.rays_m[0].max() != both.labels.rays_m[6].max()
    assert len(both.labels.people) == len(both.labels.visible) == len(both) == 12
