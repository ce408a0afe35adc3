"""Probes of a scene's light: what falls on a human who stands somewhere.

A probe is a cube of low-resolution images of the scene's own Gaussians, drawn at chest height over the ground that
humans can walk on, projected to spherical harmonics of order 2. Scenes are display-referred: what their images show is
taken for light (`irradiance`), so that lamps and windows, which photographs clip, count as white.

Light is relative to the mean of all probes: a human in the scene's mean light has the avatar's own colours.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from readygo.common.array_files import load_npz
from readygo.common.arrays import Float64Array
from readygo.common.errors import ReadygoError, SceneError
from readygo.common.files import write_then_rename
from readygo.common.gaussians.irradiance import HARMONICS, add_radiance, irradiance_matrix
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap, clearance_m
from readygo.common.maps.fill import fill_smoothly
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import View
from readygo.common.rasterizer.packed.scene import PackedScene

FORMAT = "readygo-light/1"
"""Format of a file of probes; it changes with everything that changes their values."""
_BYTES_MAX = 2**26
"""Largest file of probes [bytes]: `PROBES_MAX` of them stand in a grid of some thousand cells of 216 bytes."""
SPACING_M = 1.0
"""Distance between probes [m]; larger where there would be too many of them."""
PROBES_MAX = 200
HEIGHT_M = 1.1
"""Height of a probe above the floor, that of a human's chest [m]."""
CLEARANCE_M = 0.25
"""A probe stands at least this far from what blocks humans."""
FACE_PX = 16
"""Edge of a cube's images."""
_R_WORLD_FACE = tuple(
    np.array(axes, dtype=np.float64).T
    for axes in (
        ((0, -1, 0), (0, 0, -1), (1, 0, 0)),
        ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
        ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
        ((-1, 0, 0), (0, 0, -1), (0, -1, 0)),
        ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    )
)
"""Cameras of a cube's faces, OpenCV axes: columns are right, down and forward in the world."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LightProbes:
    """Light on a grid over a scene's ground."""

    frame: GridFrame
    """Frame of the grid's cells in the world."""
    sh: Float64Array
    """Radiance in a cell relative to the scene's mean, shape (H, W, 9, 3); cells without a probe are filled in."""

    def at(self, x_m: float, y_m: float) -> Float64Array:
        """Light at a point, bilinear between cell centres, held constant beyond the grid.

        Args:
            x_m: World x [m].
            y_m: World y [m].

        Returns:
            Irradiance relative to the scene's mean, as in `irradiance_matrix`, shape (3, 4, 4).
        """
        sh = np.empty((HARMONICS, 3))
        _mix(self.sh, self.frame.origin_x_m, self.frame.origin_y_m, self.frame.resolution_m, x_m, y_m, sh)
        return irradiance_matrix(sh)


@kernel_with_cache
def _mix(
    grid: Float64Array, origin_x: float, origin_y: float, resolution: float, x: float, y: float, sh: Float64Array
) -> None:
    """Write the coefficients at a point, shape (9, 3)."""
    height, width = grid.shape[:2]
    u = min(max((x - origin_x) / resolution - 0.5, 0.0), width - 1.0)
    v = min(max((y - origin_y) / resolution - 0.5, 0.0), height - 1.0)
    j, i = int(u), int(v)
    j1, i1, a, b = min(j + 1, width - 1), min(i + 1, height - 1), u - j, v - i
    for k in range(9):
        for channel in range(3):
            low = (1.0 - a) * grid[i, j, k, channel] + a * grid[i, j1, k, channel]
            high = (1.0 - a) * grid[i1, j, k, channel] + a * grid[i1, j1, k, channel]
            sh[k, channel] = (1.0 - b) * low + b * high


def load_or_make_probes(path: Path, make: Callable[[], LightProbes]) -> LightProbes:
    """The probes in a file; made and written there if it is missing or damaged.

    Args:
        path: File whose name carries the hash of the scene.
        make: Makes the probes.

    Returns:
        The probes, also where nothing can be written.
    """
    loaded = _load(path)
    if loaded is not None:
        return loaded
    made = make()
    frame = (made.frame.origin_x_m, made.frame.origin_y_m, made.frame.resolution_m)
    try:
        with write_then_rename(path) as part:
            np.savez(part, format=np.array(FORMAT), frame=np.array(frame), sh=made.sh)
    except ReadygoError:
        # A bundle on a read-only disk: every process makes its own.
        return made
    return made


def _load(path: Path) -> LightProbes | None:
    try:
        arrays = load_npz(path, ("frame", "sh", "format"), bytes_max=_BYTES_MAX, raises=SceneError)
        x_m, y_m, resolution_m = (float(value) for value in arrays["frame"])
        sh: Float64Array = arrays["sh"]
        form = str(arrays["format"])
    except (SceneError, ValueError, TypeError, KeyError):
        return None
    if form != FORMAT or sh.ndim != 4 or sh.shape[2:] != (HARMONICS, 3) or sh.dtype != np.float64:
        return None
    return LightProbes(frame=GridFrame(origin_x_m=x_m, origin_y_m=y_m, resolution_m=resolution_m), sh=sh)


def make_probes(clouds: Sequence[PackedScene], human: OccupancyMap, floor: FloorMap) -> LightProbes:
    """Probe a scene: a few seconds on one core.

    Args:
        clouds: The scene and its sky.
        human: What blocks humans.
        floor: Height of the floor.
    """
    frame, shape, cells, places = _standpoints(human, floor)
    rasterizer = CpuRasterizer(clouds, {}, _face_K_px(), FACE_PX, FACE_PX)
    shown, alpha = np.empty((len(places), 6 * FACE_PX**2, 3)), np.empty((len(places), 6 * FACE_PX**2, 1))
    for number, place in enumerate(places):
        images = rasterizer.render([View(T_world_camera=_pose(R, place)) for R in _R_WORLD_FACE], ("rgb", "alpha"))
        assert images.alpha is not None
        shown[number], alpha[number] = images.rgb.reshape(-1, 3) / 255.0, images.alpha.reshape(-1, 1)
    # Where a scene has nothing, such as a sky, it sends the light that the rest of it does.
    seen = alpha.sum()
    unseen = shown.sum(axis=(0, 1)) / seen if seen > 0.0 else np.ones(3)
    return LightProbes(frame=frame, sh=_relative(shown + (1.0 - alpha) * unseen, cells, shape))


def _standpoints(
    human: OccupancyMap, floor: FloorMap
) -> tuple[GridFrame, tuple[int, int], list[tuple[int, int]], list[Float64Array]]:
    """The grid of probes, its shape, the cells that have a probe, and where these are [m]."""
    free = clearance_m(human) > CLEARANCE_M
    edge_m = human.frame.resolution_m
    wanted_m = max(SPACING_M, math.sqrt(float(free.sum()) * edge_m * edge_m / PROBES_MAX))
    step = max(math.ceil(wanted_m / edge_m - 1e-9), 1)
    shape = (-(-free.shape[0] // step), -(-free.shape[1] // step))
    frame = GridFrame(origin_x_m=human.frame.origin_x_m, origin_y_m=human.frame.origin_y_m, resolution_m=step * edge_m)
    cells, places = [], []
    for i in range(shape[0]):
        for j in range(shape[1]):
            rows, columns = np.nonzero(free[i * step : (i + 1) * step, j * step : (j + 1) * step])
            if len(rows) == 0:
                continue
            away = (2 * rows - step + 1) ** 2 + (2 * columns - step + 1) ** 2
            nearest = int(np.argmin(away))
            x_m, y_m = human.frame.centre_m(i * step + int(rows[nearest]), j * step + int(columns[nearest]))
            cells.append((i, j))
            places.append(np.array([x_m, y_m, floor.at(x_m, y_m) + HEIGHT_M]))
    return frame, shape, cells, places


def _relative(shown: Float64Array, cells: Sequence[tuple[int, int]], shape: tuple[int, int]) -> Float64Array:
    """Harmonics of what cubes show, relative to their mean, on the grid, shape (H, W, 9, 3)."""
    grid = np.zeros((*shape, HARMONICS, 3))
    if not cells:
        grid[:, :, 0] = math.sqrt(4.0 * math.pi)
        return grid
    direction, solid_angle = _face_directions()
    for (i, j), display in zip(cells, shown, strict=True):
        add_radiance(display * display, direction, solid_angle, grid[i, j])
    known = np.zeros(shape, dtype=np.bool_)
    known[tuple(np.array(cells).T)] = True
    mean = _mean_radiance(grid[known])
    for k in range(HARMONICS):
        for channel in range(3):
            grid[:, :, k, channel] = fill_smoothly(grid[:, :, k, channel], known) / mean[channel]
    return grid


def _mean_radiance(sh: Float64Array) -> Float64Array:
    """Mean over probes and directions per channel, shape (3,); not 0."""
    total = np.zeros(3)
    for probe in sh:
        total += probe[0]
    return np.maximum(total / (len(sh) * math.sqrt(4.0 * math.pi)), 1e-6)


def _face_K_px() -> Float64Array:
    half = 0.5 * FACE_PX
    return np.array([[half, 0.0, half], [0.0, half, half], [0.0, 0.0, 1.0]])


def _pose(R: Float64Array, place_m: Float64Array) -> Float64Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, place_m
    return pose


def _face_directions() -> tuple[Float64Array, Float64Array]:
    """Directions of a cube's pixels in the world (6 P, 3), and their solid angles [sr] (6 P,), 4 pi in all."""
    across = (np.arange(FACE_PX) + 0.5) / (0.5 * FACE_PX) - 1.0
    v, u = np.meshgrid(across, across, indexing="ij")
    length = np.sqrt(u * u + v * v + 1.0).reshape(-1)
    x, y, z = u.reshape(-1) / length, v.reshape(-1) / length, 1.0 / length
    directions = [x[:, None] * R[:, 0] + y[:, None] * R[:, 1] + z[:, None] * R[:, 2] for R in _R_WORLD_FACE]
    weight = np.tile(1.0 / (length * length * length), len(_R_WORLD_FACE))
    return np.concatenate(directions), weight * (4.0 * math.pi / float(weight.sum()))
