import numpy as np
import torch

from services.trainer.augment import corrupt_previous, shift_frames, vary_light


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
