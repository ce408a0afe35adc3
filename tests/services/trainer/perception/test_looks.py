import numpy as np

from readygo.services.trainer.perception.looks import grey_of, held_out, joined
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
    assert both.scene.tolist() == [0] * 12 + [1] * 9
    np.testing.assert_array_equal(both.labels.people[12:], second.labels.people)


def test_whole_episodes_are_held_out_the_same_ones_for_a_seed() -> None:
    looks = make_looks(60, episodes=10)
    chosen = held_out(looks, 0.2, seed=3)
    assert len(set(looks.episode[chosen].tolist())) == 2
    assert not set(looks.episode[chosen].tolist()) & set(looks.episode[~chosen].tolist())
    np.testing.assert_array_equal(chosen, held_out(looks, 0.2, seed=3))
    assert not held_out(looks, 0.0, seed=3).any()
