import numpy as np
import pytest

from readygo.common.arrays import Float16Array, Int64Array
from readygo.common.robot import RobotConfig
from readygo.services.trainer.frames import FrameCache
from readygo.services.trainer.looked import LookCache
from readygo.services.trainer.parts import timing_of
from readygo.services.trainer.reservoir import Reservoir
from readygo.services.trainer.samples import TrainingSamples, episode_table, join_tables
from tests.services.trainer.conftest import QUICK, make_one

BYTES = 2 * 3 * 2
"""Of what is kept of one sample."""


class Looks:
    """Tells the number of each sample in its episode, and notes whom it was asked about."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def __call__(self, table: TrainingSamples, frames: FrameCache, samples: Int64Array) -> Float16Array:
        self.asked += sorted({table.names[row] for row in table.episode[samples].tolist()})
        steps = samples - table.first[samples]
        return np.broadcast_to(steps[:, None, None], (len(samples), 3, 2)).astype(np.float16)


def table_of(*names: str) -> TrainingSamples:
    robot = RobotConfig()
    return join_tables([episode_table(make_one(name, samples=30), robot, timing_of(robot, QUICK)) for name in names])


def cache_of(room: int) -> LookCache:
    frames = FrameCache(Reservoir(10**6), RobotConfig(), pooling=1, limit_bytes=0)
    return LookCache(frames, limit_bytes=room * BYTES)


def test_samples_are_given_in_the_order_asked_for_and_episodes_are_looked_at_once() -> None:
    table, looks, cache = table_of("a", "b"), Looks(), cache_of(1000)
    samples = np.array([41, 3, 58, 7, 3])
    for _ in range(2):
        assert cache.get(table, samples, looks)[:, 0, 0].tolist() == [11, 3, 28, 7, 3]
    assert looks.asked == ["a", "b"]
    assert cache.get(table, samples, looks).shape == (5, 3, 2)


@pytest.mark.parametrize(("room", "asked"), [(30, ["a", "b", "b"]), (60, ["a", "b"]), (0, ["a", "b", "a", "b"])])
def test_what_does_not_fit_is_looked_at_again(room: int, asked: list[str]) -> None:
    table, looks, cache = table_of("a", "b"), Looks(), cache_of(room)
    for _ in range(2):
        cache.get(table, np.array([3, 41]), looks)
    assert looks.asked == asked


def test_dropped_episodes_make_room() -> None:
    looks, cache = Looks(), cache_of(30)
    cache.get(table_of("a"), np.array([3]), looks)
    for _ in range(2):
        assert cache.get(table_of("b", "c"), np.array([3]), looks)[0, 0, 0] == 3
    assert looks.asked == ["a", "b"]


def test_only_usable_samples_are_looked_at() -> None:
    table, cache = table_of("a"), cache_of(100)
    table.usable[:] = np.arange(30) % 4 == 0
    asked: list[Int64Array] = []

    def look(table: TrainingSamples, frames: FrameCache, samples: Int64Array) -> Float16Array:
        asked.append(samples)
        return samples[:, None, None].astype(np.float16)

    assert cache.get(table, np.array([24, 8]), look)[:, 0, 0].tolist() == [24, 8]
    assert asked[0].tolist() == list(range(0, 30, 4))
