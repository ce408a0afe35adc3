import numpy as np

from readygo.common.messages import EpisodeKey, Split
from readygo.services.renderer.sensor.streams import SensorStream


def numbers(generator: np.random.Generator) -> list[float]:
    return generator.random(4).tolist()


def key(index: int, split: Split = Split.TRAIN, seed: int = 1) -> EpisodeKey:
    return EpisodeKey(seed=seed, split=split, index=index)


def test_stream_is_a_function_of_the_episode_and_the_frame() -> None:
    one, again = (SensorStream.of_episode(key(3)) for _ in range(2))
    assert one == again
    assert numbers(one.of_frame(7)) == numbers(again.of_frame(7)) == numbers(one.of_frame(7))


def test_draws_and_frames_and_episodes_have_numbers_of_their_own() -> None:
    streams = [SensorStream.of_episode(k) for k in (key(0), key(1), key(0, Split.TEST), key(0, seed=2))]
    streams += [SensorStream.of_humans(name) for name in ("", "a", "b")]
    found = [tuple(numbers(stream.of_draws())) for stream in streams]
    found += [tuple(numbers(stream.of_frame(step))) for stream in streams for step in range(3)]
    assert len(set(found)) == len(found)
