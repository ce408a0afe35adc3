import dataclasses

import cv2
import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.camera.depth import depth_bytes, depth_rng, measured_depth
from readygo.common.errors import DatasetError
from readygo.common.images.files import decode_output, encode_output
from readygo.common.images.images import Images
from readygo.common.robot import RobotConfig
from readygo.services.trainer import frames as frames_module
from readygo.services.trainer.frames import FrameCache
from readygo.services.trainer.pooling import pool
from readygo.services.trainer.reservoir import Reservoir
from readygo.services.trainer.samples import WindowTiming, episode_table, join_tables
from tests.services.trainer.conftest import make_one, png

CAMERA = CameraConfig(height_px=16, width_px=32)
FRAME_BYTES = 16 * 32 * 3


def pictures(seed=0, size=(16, 32)):
    return np.random.default_rng(seed).integers(0, 256, (10, *size, 3), np.uint8)


@pytest.fixture
def decodings(monkeypatch):
    """Counts what is decoded."""
    counted = []
    decode = frames_module.decode_image
    monkeypatch.setattr(frames_module, "decode_image", lambda data: (counted.append(1), decode(data))[1])
    return counted


def make_cache(frames, *, room, pooling=1):
    reservoir = Reservoir(10**9)
    for name, seen in frames.items():
        reservoir.add(episode_of(name, tuple(png(picture) for picture in seen)))
    size = FRAME_BYTES // pooling**2
    cache = FrameCache(reservoir, RobotConfig(camera=CAMERA), pooling=pooling, limit_bytes=int(room * size))
    return reservoir, cache, table_of(reservoir)


def episode_of(name, images):
    return dataclasses.replace(make_one(name, samples=len(images)), images=images)


def table_of(reservoir):
    return join_tables(
        [
            episode_table(episode, RobotConfig(), WindowTiming(spacing_steps=2))
            for episode in reservoir.episodes.values()
        ]
    )


def test_frames_come_in_the_order_asked_for():
    seen = {"a": pictures(1), "b": pictures(2)}
    _, cache, table = make_cache(seen, room=100)
    frames = cache.get(table, np.array([17, 3, 17]))
    assert np.array_equal(frames, [seen["b"][7], seen["a"][3], seen["b"][7]])


@pytest.mark.parametrize(("room", "decoded_again"), [(10, 0), (3.9, 7), (0, 10)])
def test_first_frames_that_fit_stay_decoded_and_no_more(decodings, room, decoded_again):
    _, cache, table = make_cache({"a": pictures()}, room=room)
    cache.get(table, np.arange(10))
    assert len(decodings) == 10
    cache.get(table, np.arange(10))
    assert len(decodings) == 10 + decoded_again


def test_frames_of_an_episode_that_went_make_room(decodings):
    reservoir, cache, table = make_cache({"a": pictures()}, room=10)
    cache.get(table, np.arange(10))
    reservoir.episodes.clear()
    reservoir.add(episode_of("b", tuple(png(picture) for picture in pictures(2))))
    for _ in range(2):
        cache.get(table_of(reservoir), np.arange(10))
    assert len(decodings) == 20


def test_image_of_another_size_or_damaged_is_refused_by_name():
    for images, message in (
        ((png(pictures(size=(16, 24))[0]),), r"\(16, 24, 3\).*\(16, 32, 3\)"),
        ((b"x",), "no rgb image"),
    ):
        reservoir = Reservoir(10**6)
        reservoir.add(episode_of("abc", images))
        cache = FrameCache(reservoir, RobotConfig(camera=CAMERA), pooling=1, limit_bytes=0)
        with pytest.raises(DatasetError, match=rf"Sample 0 of episode abc has .*{message}"):
            cache.get(table_of(reservoir), np.array([0]))


def test_pooled_frames_are_what_the_cache_gives():
    seen = pictures()
    _, cache, table = make_cache({"a": seen}, room=10, pooling=2)
    assert np.array_equal(
        cache.get(table, np.array([3]))[0], cv2.resize(seen[3], (16, 8), interpolation=cv2.INTER_AREA)
    )


def test_depths_come_beside_the_colours_as_the_robots_camera_measures_them():
    camera = dataclasses.replace(CAMERA, depth_max_m=4.0, depth_lost=0.2)
    seen, depth_m = pictures(), np.linspace(0.5, 8.0, 16 * 32, dtype=np.float32).reshape(16, 32).round(3)
    file = encode_output(Images(rgb=seen[0], depth_m=depth_m), "depth")
    reservoir = Reservoir(10**9)
    episode = episode_of("a", tuple(png(picture) for picture in seen))
    reservoir.add(dataclasses.replace(episode, outputs={"depth": (file,) * 10}))
    cache = FrameCache(reservoir, RobotConfig(camera=camera), pooling=2, limit_bytes=0, images=("rgb", "depth"))
    found = cache.get(table_of(reservoir), np.array([3]))[0]
    measured_m = measured_depth(decode_output("depth", file), camera, depth_rng("a", 3))
    assert np.array_equal(found[..., :3], pool(seen[3], 2))
    assert np.array_equal(found[..., 3], depth_bytes(measured_m, camera)[1::2, 1::2])
    assert 0.15 < (found[:4, :, 3] == 0).mean() < 0.35


def test_damaged_depths_are_refused_by_name():
    reservoir = Reservoir(10**9)
    episode = episode_of("a", tuple(png(picture) for picture in pictures()))
    reservoir.add(dataclasses.replace(episode, outputs={"depth": (b"no image",) * 10}))
    cache = FrameCache(reservoir, RobotConfig(camera=CAMERA), pooling=1, limit_bytes=0, images=("rgb", "depth"))
    with pytest.raises(DatasetError, match="Sample 0 of episode a has no depth image"):
        cache.get(table_of(reservoir), np.array([0]))


def test_images_of_further_cameras_come_beside_those_of_the_first():
    seen, left = pictures(), pictures()[::-1]
    reservoir = Reservoir(10**9)
    episode = episode_of("a", tuple(png(picture) for picture in seen))
    reservoir.add(dataclasses.replace(episode, outputs={"left.rgb": tuple(png(picture) for picture in left)}))
    robot = RobotConfig(camera=CAMERA, cameras={"left": CAMERA})
    cache = FrameCache(reservoir, robot, pooling=2, limit_bytes=0, images=("rgb", "left.rgb"))
    found = cache.get(table_of(reservoir), np.array([3]))[0]
    assert np.array_equal(found, np.concatenate([pool(seen[3], 2), pool(left[3], 2)], axis=2))
