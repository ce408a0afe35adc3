import cv2
import numpy as np

from readygo.services.reconstructor.frames.select import FrameScores, choose_frames, motion, sharpness, small_grey


def textured() -> np.ndarray:
    noise = np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8)
    return cv2.resize(noise, (640, 480), interpolation=cv2.INTER_CUBIC)


def test_blur_lowers_sharpness_and_light_does_not() -> None:
    image = textured()
    assert sharpness(cv2.GaussianBlur(image, (0, 0), 5)) < 0.6 * sharpness(image)
    assert abs(sharpness((0.6 * image).astype(np.uint8)) / sharpness(image) - 1) < 0.1


def test_motion_is_a_share_of_the_width() -> None:
    image = textured()
    moved = np.roll(image, 16, axis=1)
    assert abs(motion(small_grey(image), small_grey(moved)) - 16 / 640) < 0.003
    assert motion(small_grey(image), small_grey(image)) < 1e-3


def test_sharp_frames_evenly_spread_over_the_way_are_chosen() -> None:
    sharp = np.tile([0.5, 1.0, 0.6, 0.55, 0.5], 40)
    still = np.r_[np.full(100, 0.02), np.zeros(100)]
    chosen = choose_frames(FrameScores(sharpness=sharp, motion=still), count_max=300, step=0.1)
    assert 19 <= len(chosen) <= 21
    assert (np.diff(chosen) > 0).all()
    assert (sharp[chosen] == 1.0).mean() > 0.9
    assert len(choose_frames(FrameScores(sharpness=sharp, motion=still), count_max=7, step=0.1)) == 7


def test_blurred_stretch_is_left_out() -> None:
    sharp = np.ones(100)
    sharp[48:53] = 0.1
    chosen = choose_frames(FrameScores(sharpness=sharp, motion=np.full(100, 0.02)), count_max=300, step=0.04)
    assert not set(chosen) & set(range(48, 53))
