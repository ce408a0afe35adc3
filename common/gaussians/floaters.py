"""Floaters: Gaussians in mid-air, as small groups that touch nothing, or as clouds that fill a place."""

import itertools

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians.cloud import GaussianCloud

CELLS_ACROSS, CELL_SIZES = 100, 2.0
"""Groups are looked for in cells of a hundredth of the scene's width, or of so many of the Gaussians that most surface
consists of."""
GROUP_MAX = 50
"""A group of at most so many Gaussians without a neighbour floats."""
SPARSE_RATIO, SPARSE_CELLS_MIN, SPARSE_AREA_MAX = 0.05, 0.6, 0.02
"""Cells with a smaller part of what full ones hold are sparse: in sound scenes up to 42 % of the cells that hold
anything, at the rims of things; where more are, and have hardly any of all surface, a thin cloud of floaters surrounds
the scene. Of scenes of few large Gaussians, as drafts are, such cells have 3 to 6 % of the surface."""
CLOUD_CELLS_ACROSS = 400
"""Dense clouds are looked for in cells as large as those Gaussians, and at least this part of the scene's width."""
CLOUD_CELLS = ((1, 1.0), (2, 0.25), (4, 0.25))
"""And in larger ones, so many times, if the clouds have at most this part of all surface: a bed of flowers has half of
its surface in cells that are thin like those of a cloud, rooms full of dust a tenth."""
THIN = 0.5
"""The Gaussians of a thin cell cover less than this part of one of its faces; surfaces cover about all of it."""
WINDOW, FILLED = 9, 0.4
"""A cloud fills this part of the cells around, so many a side, with thin ones; surfaces with their rims do not."""
WINDOW_SHARE_MAX = 0.4
"""Where those cells around are a larger part of the scene's width, they hold rooms with all that is in them, and tell
nothing: so it is in scenes of few large Gaussians."""
FILLED_SHARE = 0.03
"""In sound scenes at most 1 % of the occupied cells lie in such a cloud, with 100,000 floaters in a flat over 4 %."""
FLOATER_LEVELS, LIMITS = 2.0, (0.3, 0.6)
"""Cells of a cloud that cover up to so many times what its usual ones do are floaters, within these limits."""
SAMPLES_PER_AXIS_MAX = 8
SHELL_TURNS, SHELL_RINGS, SHELL_MIN = 24, 12, 0.1
"""Parts of the sphere that directions are counted in, all of one solid angle; and the share of it that sky covers with
its 1 sigma ellipses at least. Floaters around a scene have a hundredth of that."""


def floating(cloud: GaussianCloud, low: Float64Array, high: Float64Array) -> BoolArray:
    """The Gaussians that float, in any unit of length.

    Args:
        cloud: Gaussians, without huge ones and haze.
        low: Low corner of the scene without its outliers, shape (3,).
        high: Its high corner, shape (3,).

    Returns:
        Mask, shape (N,).
    """
    if len(cloud) == 0:
        return np.zeros(0, np.bool_)
    width = max(float((high - low).max()), 1e-9)
    usual = _usual_size(cloud)
    cloudy = np.zeros(len(cloud), np.bool_)
    for times, area_max in CLOUD_CELLS:
        cell = times * max(width / CLOUD_CELLS_ACROSS, usual)
        if cloudy.any() or WINDOW * cell > WINDOW_SHARE_MAX * width:
            break
        cloudy = _cloud_mask(cloud, low, high, cell, area_max)
    return cloudy | _apart(cloud, low, high, max(width / CELLS_ACROSS, CELL_SIZES * usual), sparse=not cloudy.any())


def far_shell(cloud: GaussianCloud, among: BoolArray, low: Float64Array, high: Float64Array) -> BoolArray:
    """The Gaussians outside of a scene that fill the direction that they are seen in from its middle: sky, mountains.

    Args:
        cloud: Gaussians.
        among: Which of them are judged, shape (N,).
        low: Low corner of the scene without its outliers, shape (3,).
        high: Its high corner, shape (3,).

    Returns:
        Mask, shape (N,).
    """
    outside_m = np.linalg.norm(np.maximum(low - cloud.means_m, 0) + np.maximum(cloud.means_m - high, 0), axis=1)
    shell: BoolArray = among & (outside_m > cloud.scales_m.max(axis=1, initial=0.0))
    far = cloud.select(shell)
    rays = far.means_m.astype(np.float64) - 0.5 * (low + high)
    distance = np.maximum(np.linalg.norm(rays, axis=1), 1e-9)
    turn = np.floor((np.arctan2(rays[:, 1], rays[:, 0]) / (2 * np.pi) + 0.5) * SHELL_TURNS).astype(np.int64)
    ring = np.floor((rays[:, 2] / distance + 1) / 2 * SHELL_RINGS).clip(0, SHELL_RINGS - 1).astype(np.int64)
    part = turn % SHELL_TURNS * SHELL_RINGS + ring
    held = np.bincount(part, _areas(far) / distance**2, SHELL_TURNS * SHELL_RINGS)
    shell[shell] = (held >= SHELL_MIN * 4 * np.pi / (SHELL_TURNS * SHELL_RINGS))[part]
    return shell


def _apart(cloud: GaussianCloud, low: Float64Array, high: Float64Array, cell: float, *, sparse: bool) -> BoolArray:
    """Gaussians of small groups of cells without an occupied neighbour, and those far outside of a box.

    With `sparse` also those of cells that hold few, where most cells do: of a thin cloud around a scene.
    """
    from scipy import ndimage

    margin = 0.5 * (high - low) + cell
    cells, inside, shape = _cells(cloud.means_m.astype(np.float64), low - margin, high + margin, cell)
    counts = np.bincount(cells, minlength=int(np.prod(shape))).reshape(shape)
    groups, count = ndimage.label(counts > 0, np.ones((3, 3, 3), np.bool_))
    sizes = np.bincount(groups.reshape(-1), counts.reshape(-1), count + 1)
    alone = sizes[groups] <= min(GROUP_MAX, 0.5 * len(cloud))
    areas = np.bincount(cells, _areas(cloud)[inside], counts.size).reshape(shape)
    few = counts < SPARSE_RATIO * np.quantile(counts.reshape(-1)[cells], 0.9)
    thin = areas[few].sum() < SPARSE_AREA_MAX * areas.sum()
    if sparse and thin and few[counts > 0].mean() > SPARSE_CELLS_MIN:
        alone |= few
    floats = ~inside
    floats[inside] = alone.reshape(-1)[cells]
    return floats


def _cloud_mask(cloud: GaussianCloud, low: Float64Array, high: Float64Array, cell: float, area_max: float) -> BoolArray:
    """Gaussians of clouds: of cells that hold something, but no surface, and fill a place."""
    from scipy import ndimage

    points, areas = _samples(cloud, cell)
    cells, inside, shape = _cells(points, low - cell, high + cell, cell)
    held = np.bincount(cells, areas[inside], int(np.prod(shape))).reshape(shape) / cell**2
    thin = (held > 0) & (held < THIN)
    filled = ndimage.uniform_filter(thin.astype(np.float32), WINDOW, mode="nearest")
    floats = np.zeros(len(cloud), np.bool_)
    dense = thin.any() and float((filled[held > 0] > FILLED).mean()) >= FILLED_SHARE
    if not dense or held[thin].sum() > area_max * held.sum():
        return floats
    near = filled > 0.5 * FILLED
    limit = np.clip(FLOATER_LEVELS * np.median(held[near & thin]), *LIMITS)
    own, inside, _ = _cells(cloud.means_m.astype(np.float64), low - cell, high + cell, cell)
    floats[inside] = (near & (held < limit)).reshape(-1)[own]
    return floats


def _cells(
    xyz: Float64Array, low: Float64Array, high: Float64Array, cell: float
) -> tuple[Int64Array, BoolArray, tuple[int, int, int]]:
    """Flat index of the cell of each point that is inside of a box, which ones that are, and the grid's shape."""
    inside = np.asarray(((xyz >= low) & (xyz <= high)).all(axis=1))
    x, y, z = (np.floor((high - low) / cell).astype(np.int64) + 1).tolist()
    i, j, k = np.floor((xyz[inside] - low) / cell).astype(np.int64).T
    flat: Int64Array = (i * y + j) * z + k
    return flat, inside, (x, y, z)


def _usual_size(cloud: GaussianCloud) -> float:
    """Size of the Gaussians that most surface consists of: dust, however much of it, does not count."""
    reach, areas = cloud.scales_m.max(axis=1).astype(np.float64), _areas(cloud)
    order = np.argsort(reach)
    total = np.cumsum(areas[order])
    return float(reach[order][np.searchsorted(total, 0.5 * total[-1])])


def _areas(cloud: GaussianCloud) -> Float64Array:
    """What each Gaussian covers with its broad side, 1 sigma, times its opacity, shape (N,)."""
    scales = np.sort(cloud.scales_m.astype(np.float64), axis=1)
    areas: Float64Array = np.pi * scales[:, 2] * scales[:, 1] * cloud.opacities
    return areas


def _samples(cloud: GaussianCloud, spacing: float) -> tuple[Float64Array, Float64Array]:
    """Points on the broad sides of Gaussians, and the area that each stands for, shapes (S, 3) and (S,)."""
    order = np.argsort(cloud.scales_m, axis=1)[:, :0:-1]
    rows = np.arange(len(cloud))[:, None]
    sizes = cloud.scales_m.astype(np.float64)[rows, order]
    sides = matrix_from_quat(cloud.quats_wxyz).swapaxes(1, 2)[rows, order] * sizes[..., None]
    counts = np.clip(np.ceil(2 * sizes / spacing), 1, SAMPLES_PER_AXIS_MAX).astype(np.int64)
    means, areas = cloud.means_m.astype(np.float64), _areas(cloud)
    points, parts = [], []
    for na, nb in np.unique(counts, axis=0).tolist():
        some = (counts == (na, nb)).all(axis=1)
        for u, v in itertools.product((2 * np.arange(na) + 1) / na - 1, (2 * np.arange(nb) + 1) / nb - 1):
            points.append(means[some] + u * sides[some, 0] + v * sides[some, 1])
            parts.append(areas[some] / (na * nb))
    return np.concatenate(points), np.concatenate(parts)
