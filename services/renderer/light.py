"""Development: the light of drawn images, added up over time and through a lens, exposed, made noisy, and sRGB again.

sRGB bytes become light and bytes again by the tables of `common/images/light.py`; what lies between rounds alike on
every CPU.
"""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from functools import cache
from statistics import NormalDist

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array, UInt8Array
from readygo.common.camera import CameraConfig
from readygo.common.images.images import Images
from readygo.common.images.light import LIGHT_ONE, byte_of_light, light_of_byte
from readygo.common.kernels import kernel_with_cache
from readygo.services.renderer.camera import TIME_ONE, EpisodeCamera, Shot, SubFrame, exposure_gain, sensor_rng
from readygo.services.renderer.faces import WEIGHT_ONE, Remap, look_up

_NORMALS = 1 << 16


@cache
def normal_of_word() -> Float32Array:
    """Normal deviates of 16-bit words: the quantiles of equal steps, shape (65536,)."""
    normal = NormalDist()
    half = [normal.inv_cdf((number + 0.5) / _NORMALS) for number in range(_NORMALS // 2)]
    return np.array([*half, *(-value for value in reversed(half))], dtype=np.float32)


def develop(camera: EpisodeCamera, shot: Shot, sub_frames: Sequence[SubFrame], drawn: Iterator[Images]) -> Images:
    """The images that a camera records of a shot; without a sensor they are what the rasterizer draws.

    Colour is what the sensor makes of the light. Depth, alpha, mask and normal have no noise and no blur: each pixel
    shows the middle of its row's exposure, at its centre. Depth is along the optical axis.

    Args:
        camera: The camera.
        shot: The shot.
        sub_frames: Its sub-frames.
        drawn: Images of their faces, in the order of `faces.face_poses`; those of this shot are taken from it.
    """
    if camera.config.ideal:
        return next(drawn)
    light = np.zeros((camera.config.height_px, camera.config.width_px, 3), dtype=np.int64)
    out: Images | None = None
    for sub_frame in sub_frames:
        faces = [next(drawn) for _ in (camera.remap.faces if camera.remap else (0,))]
        add_light(light, np.stack([face.rgb for face in faces]), camera.remap, sub_frame.weight)
        if sub_frame.rows.any():
            seen = look_up(faces, camera.remap)
            out = seen if out is None else _with_rows(out, seen, sub_frame.rows)
    assert out is not None
    config, gain = camera.config, camera.gain
    if shot.exposure_ev is not None:
        gain = exposure_gain(dataclasses.replace(config, exposure_ev=shot.exposure_ev))
    return dataclasses.replace(out, rgb=to_srgb(light, config, gain, sensor_rng(camera.key, shot.step)))


def add_light(light: Int64Array, faces: UInt8Array, remap: Remap | None, row_weight: Int64Array) -> None:
    """Let an image fall on the rows that collect light.

    Args:
        light: Sum so far, which changes, shape (H, W, 3).
        faces: sRGB, (F, Hf, Wf, 3), or the image itself as (1, H, W, 3) without a lens.
        remap: The lens.
        row_weight: Share of each row's time in 1/`TIME_ONE`, shape (H,).
    """
    source = faces.reshape(-1, 3)
    if remap is None:
        _add_image(source, light_of_byte(), row_weight, light)
    else:
        _add_remapped(source, remap.start, remap.source, remap.weight, light_of_byte(), row_weight, light)


def to_srgb(light: Int64Array, camera: CameraConfig, gain: Float64Array, rng: np.random.Generator) -> UInt8Array:
    """The collected light as sRGB bytes, shape (H, W, 3).

    Args:
        light: Sum of `add_light`, shape (H, W, 3).
        camera: With the values of this episode.
        gain: What exposure and vignetting leave of the light, shape (H, W); see `exposure_gain`.
        rng: Stream of this image's noise; nothing is drawn without noise.
    """
    noisy = camera.shot_noise > 0.0 or camera.read_noise > 0.0
    words = rng.bytes(2 * light.size) if noisy else b""
    out = np.empty(light.shape, dtype=np.uint8)
    _develop(
        light,
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


def _with_rows(images: Images, others: Images, rows: BoolArray) -> Images:
    """Images whose given rows are those of others."""
    values = {name: array.copy() for name, array in images.arrays().items()}
    for name, value in values.items():
        value[rows] = getattr(others, name)[rows]
    return Images(**values)


@kernel_with_cache(error_model="numpy")
def _add_image(source: UInt8Array, light: Int64Array, row_weight: Int64Array, out: Int64Array) -> None:
    height, width, _ = out.shape
    for i in range(height):
        if row_weight[i] > 0:
            scale = row_weight[i] * WEIGHT_ONE
            for j in range(width):
                p = i * width + j
                for c in range(3):
                    out[i, j, c] += scale * light[source[p, c]]


@kernel_with_cache(error_model="numpy")
def _add_remapped(
    source: UInt8Array,
    start: Int64Array,
    place: Int32Array,
    weight: Int32Array,
    light: Int64Array,
    row_weight: Int64Array,
    out: Int64Array,
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


@kernel_with_cache(error_model="numpy")
def _develop(
    total: Int64Array,
    gain: Float64Array,
    balance: tuple[float, float, float],
    read_variance: float,
    shot_variance: float,
    words: Int64Array,
    normals: Float32Array,
    byte_of_light: UInt8Array,
    out: UInt8Array,
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
