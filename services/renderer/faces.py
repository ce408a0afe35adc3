"""Pinhole images that hold all that a distorted image shows, and the way from the ones to the other.

Up to 60 deg from the optical axis one wide image does; beyond that faces around the camera as of a cube, as a pinhole
image would need ever more pixels there. Front and sides reach 45 deg to the right and left, and 60 deg up and down: two
more faces are rarely needed. All faces have the same intrinsics, so that one rasterizer draws them all.

Legend: (x, y) = point of a ray on the camera's plane z = 1; (fu, fv) = on the face's plane z = 1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray, Float64Array, Int32Array, Int64Array
from readygo.common.camera.lens import Lens
from readygo.common.errors import ConfigError
from readygo.common.images.images import Images
from readygo.common.kernels import kernel_with_cache

FACE_TAN_MAX = math.tan(math.radians(60.0))
OVERSAMPLING = 1.5
"""Pixels of a face per pixel of the image where they are scarcest, along each axis: interpolation then blurs no more
than the finer pixels sharpen."""
WEIGHT_ONE = 1 << 14
"""Sum of the weights of a pixel."""
_TAP_SPACING = 1.6
"""Largest distance of a pixel's samples, in pixels of the face."""
_WINDOW = 32
"""Edge of the largest footprint, in pixels of the face."""
_PIXELS_MAX = 1 << 26
_GRID = 128
"""Points of the image along each axis, at least half of this, at which faces are planned."""
_HALF_STEPS = np.array([[0.5, 0.0], [0.0, 0.5]])
R_FACE_CAMERA = np.array(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    ],
    dtype=np.float64,
)
"""Front, right, left, down, up: rotations from the camera to the faces, shape (5, 3, 3)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces:
    """Pinhole images around one camera centre."""

    cube: bool
    """False: only the front face is there."""
    focal_px: float
    cx_px: float
    cy_px: float
    height_px: int
    width_px: int

    @property
    def K_px(self) -> Float64Array:
        """Intrinsics of every face [px], shape (3, 3)."""
        f = self.focal_px
        return np.array([[f, 0.0, self.cx_px], [0.0, f, self.cy_px], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Remap:
    """Where the pixels of a distorted image come from.

    Colours are means over a pixel's area: evenly spaced samples in it go through the lens exactly, each is bilinear
    between pixels of its face, and equal sources are merged. What is not to be mixed is taken at the pixel's centre.
    All samples of a pixel come from the face that its centre looks at.
    """

    faces: tuple[int, ...]
    """Faces that are needed, places in `R_FACE_CAMERA`; F of them."""
    start: Int64Array
    """First source of each pixel, shape (H W + 1,)."""
    source: Int32Array
    """Places in the F stacked faces, shape (S,)."""
    weight: Int32Array
    """Sums to `WEIGHT_ONE` over a pixel, shape (S,)."""
    nearest: Int32Array
    """Source at the pixel's centre, shape (H, W)."""
    face: npt.NDArray[np.int8]
    """Face of each pixel, counted in `faces`, shape (H, W)."""
    depth_factor: Float64Array
    """Depth along the camera's optical axis over depth along the face's, shape (H, W)."""


def plan_faces(lenses: Sequence[Lens]) -> Faces:
    """Faces for all lenses between the given ones, which have the same image size.

    Between means that coefficients lie between theirs; what a lens shows is then bounded by its extremes, as g is
    linear in the coefficients.

    Raises:
        ConfigError: If a lens shows no ray at some pixel, or the faces would be too large.
    """
    first = lenses[0]
    stride = -(-max(first.height_px, first.width_px) // _GRID)
    uv = _grid(first.height_px, first.width_px, stride)
    rays = [_known_rays(lens, uv) for lens in lenses]
    cube = max(float(np.abs(xy).max()) for xy in rays) > FACE_TAN_MAX
    scarcest, densest = math.inf, 0.0
    low, high = np.full(2, math.inf), np.full(2, -math.inf)
    for lens, xy in zip(lenses, rays, strict=True):
        inside = np.minimum(uv, (lens.width_px - 0.5, lens.height_px - 0.5))
        right, below = (_known_rays(lens, inside + shift) for shift in _HALF_STEPS)
        least, most = _densities(_known_rays(lens, inside), right, below, cube)
        scarcest, densest = min(scarcest, least), max(densest, most)
        face_xy = _on_faces(xy, cube)
        low, high = np.minimum(low, face_xy.min(axis=0)), np.maximum(high, face_xy.max(axis=0))
    focal_px = OVERSAMPLING / scarcest
    # Beyond the grid's outermost points: half a pixel, the steps between points, and the bilinear neighbours.
    margin_px = math.ceil(2.0 + (1.0 + (stride if cube else 0.0)) * densest * focal_px)
    width_px, height_px = (math.ceil(focal_px * float(span)) + 2 * margin_px for span in high - low)
    if width_px * height_px > _PIXELS_MAX:
        raise ConfigError(
            f"The {first.distortion} lens needs {width_px}x{height_px} px to be drawn sharply; use a smaller image."
        )
    return Faces(
        cube=cube,
        focal_px=focal_px,
        cx_px=margin_px - focal_px * float(low[0]),
        cy_px=margin_px - focal_px * float(low[1]),
        height_px=height_px,
        width_px=width_px,
    )


def make_remap(lens: Lens, faces: Faces) -> Remap:
    """The way from `faces` to the image behind a lens.

    Raises:
        ConfigError: If the lens shows no ray at some pixel.
    """
    height, width = lens.height_px, lens.width_px
    centres = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1).reshape(-1, 2)
    xy = _known_rays(lens, centres)
    place = _face_places(xy, faces.cube)
    used = np.unique(place)
    face = np.searchsorted(used, place)
    right, below = (_known_rays(lens, centres + shift) for shift in _HALF_STEPS)
    taps = _tap_counts(right, below, xy, faces)
    start = np.zeros(height * width + 1, dtype=np.int64)
    sources: list[Int32Array] = []
    weights: list[Int32Array] = []
    for row in range(height):
        pixels = slice(row * width, (row + 1) * width)
        samples, first = _samples(centres[pixels], taps[pixels])
        uv = _face_uv(_known_rays(lens, samples), np.repeat(place[pixels], np.diff(first)), faces)
        count, source, weight = _merge_faces(uv, first, faces.height_px, faces.width_px)
        start[row * width + 1 : (row + 1) * width + 1] = count
        offset = np.repeat(face[pixels], count) * (faces.height_px * faces.width_px)
        sources.append((source + offset).astype(np.int32))
        weights.append(weight)
    uv = _face_uv(xy, place, faces)
    column = np.clip(np.floor(uv[:, 0]).astype(np.int64), 0, faces.width_px - 1)
    line = np.clip(np.floor(uv[:, 1]).astype(np.int64), 0, faces.height_px - 1)
    nearest = (face * faces.height_px + line) * faces.width_px + column
    return Remap(
        faces=tuple(used.tolist()),
        start=np.cumsum(start),
        source=np.concatenate(sources),
        weight=np.concatenate(weights),
        nearest=nearest.astype(np.int32).reshape(height, width),
        face=face.astype(np.int8).reshape(height, width),
        depth_factor=(1.0 / _along_axis(xy, place)).reshape(height, width),
    )


def face_poses(T_world_camera: Float64Array, remap: Remap | None) -> list[Float64Array]:
    """Poses of the cameras that draw the faces, shape (4, 4) each; without a lens that of the camera itself."""
    if remap is None:
        return [T_world_camera]
    poses = []
    for face in remap.faces:
        pose = T_world_camera.copy()
        for k, axis in enumerate(R_FACE_CAMERA[face]):
            pose[:3, k] = axis[0] * T_world_camera[:3, 0] + axis[1] * T_world_camera[:3, 1]
            pose[:3, k] += axis[2] * T_world_camera[:3, 2]
        poses.append(pose)
    return poses


def look_up(faces: Sequence[Images], remap: Remap | None) -> Images:
    """Images of the faces at the centres of the distorted image's pixels.

    Depth becomes that along the camera's optical axis, and normals turn from the faces' frames into the camera's.
    """
    if remap is None:
        return faces[0]
    values: dict[str, AnyArray] = {}
    for name in faces[0].arrays():
        stacked = np.stack([getattr(face, name) for face in faces])
        value = stacked.reshape(-1, *stacked.shape[3:])[remap.nearest]
        if name in ("depth_m", "median_depth_m"):
            value = (value * remap.depth_factor).astype(np.float32)
        elif name == "normal":
            R = R_FACE_CAMERA[list(remap.faces)][remap.face].astype(np.float32)
            n = value
            turned = [R[..., 0, i] * n[..., 0] + R[..., 1, i] * n[..., 1] + R[..., 2, i] * n[..., 2] for i in range(3)]
            value = np.stack(turned, axis=-1).astype(np.float32)
        values[name] = value
    return Images(**values)


def _grid(height_px: int, width_px: int, stride: int) -> Float64Array:
    """Pixel corners, the image's borders among them, shape (N, 2)."""
    u = np.append(np.arange(0.0, width_px, stride), float(width_px))
    v = np.append(np.arange(0.0, height_px, stride), float(height_px))
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def _known_rays(lens: Lens, uv: Float64Array) -> Float64Array:
    rays = lens.rays(uv)
    if np.isnan(rays).any():
        raise ConfigError(f"The {lens.distortion} distortion {lens.coefficients} folds the image; use smaller values.")
    return rays


def _face_places(xy: Float64Array, cube: bool) -> Int64Array:
    """The face that each ray goes through, shape (N,)."""
    if not cube:
        return np.zeros(len(xy), dtype=np.int64)
    x, y = xy.T
    beside = np.where(x > 0, 1, 2)
    upright = np.where(y > 0, 3, 4)
    around = np.where(np.abs(x) <= 1.0, 0, beside)
    level = np.abs(y) <= FACE_TAN_MAX * np.maximum(np.abs(x), 1.0)
    return np.where(level, around, upright).astype(np.int64)


def _along_axis(xy: Float64Array, place: Int64Array) -> Float64Array:
    """Depth along the axes of faces of the points (x, y, 1), shape (N,)."""
    R = R_FACE_CAMERA[place]
    depth: Float64Array = R[:, 2, 0] * xy[:, 0] + R[:, 2, 1] * xy[:, 1] + R[:, 2, 2]
    return depth


def _in_face(xy: Float64Array, place: Int64Array) -> Float64Array:
    """(fu, fv) of rays in the given faces, shape (N, 2)."""
    R, depth = R_FACE_CAMERA[place], _along_axis(xy, place)
    return np.stack([(R[:, i, 0] * xy[:, 0] + R[:, i, 1] * xy[:, 1] + R[:, i, 2]) / depth for i in (0, 1)], axis=1)


def _on_faces(xy: Float64Array, cube: bool) -> Float64Array:
    return _in_face(xy, _face_places(xy, cube))


def _face_uv(xy: Float64Array, place: Int64Array, faces: Faces) -> Float64Array:
    """Pixels of the faces, centres at +0.5, shape (N, 2)."""
    return _in_face(xy, place) * faces.focal_px + (faces.cx_px, faces.cy_px)


def _densities(xy: Float64Array, right: Float64Array, below: Float64Array, cube: bool) -> tuple[float, float]:
    """Least and greatest stretch from image to face, in units of 1/px, from rays half a pixel apart."""
    place = _face_places(xy, cube)
    centre = _in_face(xy, place)
    least, most = _stretch(2.0 * (_in_face(right, place) - centre), 2.0 * (_in_face(below, place) - centre))
    return float(least.min()), float(most.max())


def _stretch(a: Float64Array, b: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Singular values of matrices with columns `a` and `b`, shapes (N, 2) -> (N,), (N,)."""
    half_sum = 0.5 * (a[:, 0] * a[:, 0] + a[:, 1] * a[:, 1] + b[:, 0] * b[:, 0] + b[:, 1] * b[:, 1])
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    root = np.sqrt(np.maximum(half_sum * half_sum - area * area, 0.0))
    most = np.sqrt(half_sum + root)
    return np.abs(area) / most, most


def _tap_counts(right: Float64Array, below: Float64Array, xy: Float64Array, faces: Faces) -> Int64Array:
    """Samples per pixel along each axis, shape (N,)."""
    place = _face_places(xy, faces.cube)
    centre = _in_face(xy, place)
    _, most = _stretch(2.0 * (_in_face(right, place) - centre), 2.0 * (_in_face(below, place) - centre))
    counts = np.ceil(most * faces.focal_px / _TAP_SPACING - 1e-6).astype(np.int64)
    return np.clip(counts, 1, _WINDOW)


def _samples(centres: Float64Array, taps: Int64Array) -> tuple[Float64Array, Int64Array]:
    """Evenly spaced samples in pixels, shape (M, 2), and the first one of each pixel, shape (N + 1,)."""
    first = np.concatenate([[0], np.cumsum(taps * taps)])
    per = np.repeat(taps, taps * taps)
    number = np.arange(first[-1]) - np.repeat(first[:-1], taps * taps)
    offset = np.stack([(number % per + 0.5) / per - 0.5, (number // per + 0.5) / per - 0.5], axis=1)
    return np.repeat(centres, taps * taps, axis=0) + offset, first


@kernel_with_cache(error_model="numpy")
def _merge_faces(
    uv: Float64Array, first: Int64Array, height: int, width: int
) -> tuple[Int64Array, Int32Array, Int32Array]:
    """Sources of pixels: how many each has, their places in the face, and integer weights."""
    pixels = len(first) - 1
    count = np.zeros(pixels, np.int64)
    source = np.empty(4 * len(uv), np.int32)
    weight = np.empty(4 * len(uv), np.int32)
    window = np.zeros((_WINDOW, _WINDOW))
    n = 0
    for p in range(pixels):
        samples = uv[first[p] : first[p + 1]]
        left = math.floor(samples[:, 0].min() - 0.5)
        top = math.floor(samples[:, 1].min() - 0.5)
        window[:] = 0.0
        for k in range(len(samples)):
            a, b = samples[k, 0] - 0.5 - left, samples[k, 1] - 0.5 - top
            j, i = min(math.floor(a), _WINDOW - 2), min(math.floor(b), _WINDOW - 2)
            a, b = min(a - j, 1.0), min(b - i, 1.0)
            window[i, j] += (1.0 - a) * (1.0 - b)
            window[i, j + 1] += a * (1.0 - b)
            window[i + 1, j] += (1.0 - a) * b
            window[i + 1, j + 1] += a * b
        begin, total, largest = n, 0, n
        for i in range(_WINDOW):
            for j in range(_WINDOW):
                share = math.floor(window[i, j] / len(samples) * WEIGHT_ONE + 0.5)
                if share > 0:
                    line = min(max(top + i, 0), height - 1)
                    source[n] = line * width + min(max(left + j, 0), width - 1)
                    weight[n] = share
                    total += share
                    largest = n if share > weight[largest] or n == begin else largest
                    n += 1
        weight[largest] += WEIGHT_ONE - total
        count[p] = n - begin
    return count, source[:n].copy(), weight[:n].copy()
