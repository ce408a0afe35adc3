"""Light of sRGB images: what pixels are means of.

sRGB bytes become light by a table of 16-bit numbers and light becomes bytes by another one, both made with scalar
functions, alike on every CPU.
"""

import math
from functools import cache

import numpy as np

from readygo.common.arrays import Int64Array, UInt8Array

LIGHT_ONE = 65535
"""White in the tables."""


@cache
def light_of_byte() -> Int64Array:
    """Light of each sRGB byte, in 1/65535 of white, shape (256,). Source: IEC 61966-2-1."""
    light = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (byte / 255 for byte in range(256))]
    return np.array([math.floor(value * LIGHT_ONE + 0.5) for value in light], dtype=np.int64)


@cache
def byte_of_light() -> UInt8Array:
    """The sRGB byte of each light, shape (65536,)."""
    codes = [
        12.92 * light if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055
        for light in (number / LIGHT_ONE for number in range(LIGHT_ONE + 1))
    ]
    return np.array([math.floor(code * 255 + 0.5) for code in codes], dtype=np.uint8)
