import numpy as np
import pytest

from readygo.common.errors import DatasetError
from readygo.services.trainer.frames import FrameCache

FRAME_BYTES = 32 * 64 * 3


def cache_of(source, frames):
    return FrameCache(source, height_px=32, width_px=64, limit_bytes=int(frames * FRAME_BYTES))


def test_frames_come_in_the_order_asked_for(source):
    frames = cache_of(source, 100).get(np.array([7, 3, 7]))
    assert np.array_equal(frames, [source.decode(7), source.decode(3), source.decode(7)])
    assert not np.array_equal(frames[0], frames[1])


@pytest.mark.parametrize(("room", "decoded_again"), [(10, 0), (3.9, 7), (0, 10)])
def test_first_frames_that_fit_stay_decoded_and_no_more(source, room, decoded_again):
    cache, samples = cache_of(source, room), np.arange(10)
    cache.get(samples)
    assert source.decoded == 10
    cache.get(samples)
    assert source.decoded == 10 + decoded_again


def test_image_of_another_size_is_refused_with_both_sizes(source):
    cache = FrameCache(source, height_px=32, width_px=48, limit_bytes=0)
    with pytest.raises(DatasetError, match=r"Sample 4 .*\(32, 64, 3\).*\(32, 48, 3\)"):
        cache.get(np.array([4]))
