"""Which views a step of a training draws."""

import numpy as np

from readygo.common.arrays import Int64Array


def batch_views(train: tuple[int, ...], step: int, batch: int, seed: int) -> list[int]:
    """The views of a step: all in random order, then all in another one, and so on."""
    places = range(step * batch, (step + 1) * batch)
    orders = {epoch: _order(len(train), seed, epoch) for epoch in {place // len(train) for place in places}}
    return [train[orders[place // len(train)][place % len(train)]] for place in places]


def _order(count: int, seed: int, epoch: int) -> Int64Array:
    return np.random.default_rng((seed, epoch, 1)).permutation(count)
