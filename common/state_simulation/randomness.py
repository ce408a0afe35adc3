"""Random numbers in kernels: every robot has its stream, whose state is one integer of an array.

Source: Steele, Lea & Flood, Fast splittable pseudorandom number generators, OOPSLA 2014 (SplitMix64).
"""

import math

import numpy as np

from readygo.common.arrays import UInt64Array
from readygo.common.kernels import kernel_with_cache

_STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_A, _B, _C, _D = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_SHARE = 1.0 / (1 << 53)


@kernel_with_cache
def next_uniform(state: UInt64Array) -> float:
    """The next number of a stream, uniform in [0, 1).

    Args:
        state: The stream's state, shape (1,).
    """
    state[0] += _STEP
    z = state[0]
    z = (z ^ (z >> _A)) * _FIRST
    z = (z ^ (z >> _B)) * _SECOND
    z = z ^ (z >> _C)
    return float(z >> _D) * _SHARE


@kernel_with_cache
def next_normal(state: UInt64Array) -> float:
    """The next number of a stream, normal with mean 0 and variance 1 (Box-Muller).

    Args:
        state: The stream's state, shape (1,).
    """
    radius = math.sqrt(-2.0 * math.log(1.0 - next_uniform(state)))
    return radius * math.cos(2.0 * math.pi * next_uniform(state))


@kernel_with_cache
def next_index(state: UInt64Array, count: int) -> int:
    """The next number of a stream, uniform in 0 .. count - 1."""
    return min(int(next_uniform(state) * count), count - 1)
