"""Linear light: images added up over time and through a lens, then exposed, made noisy and encoded.

sRGB bytes become light by a table of 16-bit numbers and light becomes bytes by another one, both made with scalar
functions; what lies between rounds alike on every CPU.
"""

import math
from functools import cache
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from readygo.common.camera import CameraConfig
from readygo.common.kernels import compiled
from readygo.services.renderer.sensor.faces import WEIGHT_ONE, Remap

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

LIGHT_ONE = 65535
"""White in the tables."""
TIME_ONE = 1 << 12
"""Sum of the weights of the images that a row is made of."""
_NORMALS = 1 << 16


@cache
def light_of_byte() -> Integers:
    """Light of each sRGB byte, in 1/65535 of white, shape (256,). Source: IEC 61966-2-1."""
    light = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (byte / 255 for byte in range(256))]
    return np.array([math.floor(value * LIGHT_ONE + 0.5) for value in light], dtype=np.int64)


@cache
def byte_of_light() -> npt.NDArray[np.uint8]:
    """The sRGB byte of each light, shape (65536,)."""
    codes = [
        12.92 * light if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055
        for light in (number / LIGHT_ONE for number in range(LIGHT_ONE + 1))
    ]
    return np.array([math.floor(code * 255 + 0.5) for code in codes], dtype=np.uint8)


@cache
def normal_of_word() -> npt.NDArray[np.float32]:
    """Normal deviates of 16-bit words: the quantiles of equal steps, shape (65536,)."""
    normal = NormalDist()
    half = [normal.inv_cdf((number + 0.5) / _NORMALS) for number in range(_NORMALS // 2)]
    return np.array([*half, *(-value for value in reversed(half))], dtype=np.float32)


class LightSum:
    """Light that falls on a sensor of H x W pixels while images come and go.

    Args:
        height_px: H.
        width_px: W.
    """

    def __init__(self, height_px: int, width_px: int) -> None:
        self._sum = np.zeros((height_px, width_px, 3), dtype=np.int64)

    def clear(self) -> None:
        """Clear the collected light for the next frame."""
        self._sum[:] = 0

    def add(self, faces: npt.NDArray[np.uint8], remap: Remap | None, row_weight: Integers) -> None:
        """Let an image fall on the rows that collect light.

        Args:
            faces: sRGB, (F, Hf, Wf, 3), or the image itself as (1, H, W, 3) without a lens.
            remap: The lens.
            row_weight: Share of each row's time in 1/`TIME_ONE`, shape (H,).
        """
        source = faces.reshape(-1, 3)
        if remap is None:
            _add_image(source, light_of_byte(), row_weight, self._sum)
        else:
            _add_remapped(source, remap.start, remap.source, remap.weight, light_of_byte(), row_weight, self._sum)

    def developed(
        self, camera: CameraConfig, gain: npt.NDArray[np.float64], rng: np.random.Generator
    ) -> npt.NDArray[np.uint8]:
        """The image as sRGB bytes, shape (H, W, 3).

        Args:
            camera: With the values of this episode.
            gain: What exposure and vignetting leave of the light, shape (H, W); see `exposure_gain`.
            rng: Stream of this frame's noise; nothing is drawn without noise.
        """
        noisy = camera.shot_noise > 0.0 or camera.read_noise > 0.0
        words = rng.bytes(2 * self._sum.size) if noisy else b""
        out = np.empty(self._sum.shape, dtype=np.uint8)
        _develop(
            self._sum,
            gain,
            (camera.red_gain, 1.0, camera.blue_gain),
            camera.read_noise * camera.read_noise,
            camera.shot_noise * camera.shot_noise,
            np.frombuffer(words, dtype="<u2").astype(np.int64),
            normal_of_word(),
            byte_of_light(),
            out,
        )
        return out


def exposure_gain(camera: CameraConfig) -> Floats:
    """Factor on the light of each pixel from exposure and vignetting, shape (H, W)."""
    height_px, width_px = camera.height_px, camera.width_px
    u = (np.arange(width_px) + 0.5 - 0.5 * width_px)[None, :]
    v = (np.arange(height_px) + 0.5 - 0.5 * height_px)[:, None]
    corner2 = 0.25 * (height_px * height_px + width_px * width_px)
    gain: Floats = 2.0**camera.exposure_ev * (1.0 - camera.vignetting * (u * u + v * v) / corner2)
    return gain


@compiled(error_model="numpy")
def _add_image(source: npt.NDArray[np.uint8], light: Integers, row_weight: Integers, out: Integers) -> None:
    height, width, _ = out.shape
    for i in range(height):
        if row_weight[i] > 0:
            scale = row_weight[i] * WEIGHT_ONE
            for j in range(width):
                p = i * width + j
                for c in range(3):
                    out[i, j, c] += scale * light[source[p, c]]


@compiled(error_model="numpy")
def _add_remapped(
    source: npt.NDArray[np.uint8],
    start: Integers,
    place: npt.NDArray[np.int32],
    weight: npt.NDArray[np.int32],
    light: Integers,
    row_weight: Integers,
    out: Integers,
) -> None:
    height, width, _ = out.shape
    for i in range(height):
        if row_weight[i] > 0:
            for j in range(width):
                p = i * width + j
                red, green, blue = 0, 0, 0
                for k in range(start[p], start[p + 1]):
                    s, w = place[k], weight[k]
                    red += w * light[source[s, 0]]
                    green += w * light[source[s, 1]]
                    blue += w * light[source[s, 2]]
                out[i, j, 0] += row_weight[i] * red
                out[i, j, 1] += row_weight[i] * green
                out[i, j, 2] += row_weight[i] * blue


@compiled(error_model="numpy")
def _develop(
    total: Integers,
    gain: Floats,
    balance: tuple[float, float, float],
    read_variance: float,
    shot_variance: float,
    words: Integers,
    normals: npt.NDArray[np.float32],
    byte_of_light: npt.NDArray[np.uint8],
    out: npt.NDArray[np.uint8],
) -> None:
    height, width, _ = total.shape
    one = float(LIGHT_ONE) * float(WEIGHT_ONE) * float(TIME_ONE)
    for i in range(height):
        for j in range(width):
            for c in range(3):
                light = total[i, j, c] / one * gain[i, j]
                if len(words) > 0:
                    deviate = normals[words[(i * width + j) * 3 + c]]
                    light += math.sqrt(read_variance + shot_variance * light) * deviate
                level = math.floor(light * balance[c] * LIGHT_ONE + 0.5)
                out[i, j, c] = byte_of_light[min(max(level, 0), LIGHT_ONE)]
