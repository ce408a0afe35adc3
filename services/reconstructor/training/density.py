"""Where Gaussians are added and removed: by absolute gradients, or within a budget by MCMC.

Sources: Kerbl et al., 3D Gaussian Splatting, 2023 (clone, split, prune, reset); Ye et al., AbsGS, 2024 (absolute
gradients); Kheradmand et al., 3D Gaussian Splatting as Markov Chain Monte Carlo, 2024 (relocation, noise).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from readygo.services.reconstructor.differentiable.order import spatial_order
from readygo.services.reconstructor.differentiable.reference import rotations
from readygo.services.reconstructor.training.config import DensityConfig
from readygo.services.reconstructor.training.parameters import Change, Gaussians

SPLIT_SCALE = 0.01
"""Gaussians larger than this are split, smaller ones cloned: in extents of the scene."""
SCALE_MAX = 0.1
"""Larger ones are removed, in extents of the scene; method `gradients` only."""
STRETCH_MAX = 20.0
"""A Gaussian's longest axis is at most this many times its middle one: longer ones look right from the cameras alone,
and are needles from elsewhere."""
NOISE = 5e5
"""Size of the noise of `mcmc`, in learning rates of the means."""
REGULAR = 0.01
"""Weights of the mean opacity and the mean scale in the loss of `mcmc`."""
_SPLIT_SHRINK = 1.6
_COPIES_MAX = 16
"""A Gaussian becomes at most so many at once."""
NOISE_SLOPE, NOISE_OPACITY = 100.0, 0.005


@dataclass(eq=False)
class Sightings:
    """What the views since the last change said of N Gaussians."""

    gradient: Float32Array
    """Sum of the gradients of their projected means, absolute ones if those decide anything, shape (N,)."""
    views: Float32Array
    """Number of views in which each Gaussian had weight, shape (N,)."""

    @classmethod
    def none(cls, count: int) -> "Sightings":
        """Sightings of Gaussians that no view has seen yet."""
        return cls(np.zeros(count, dtype=np.float32), np.zeros(count, dtype=np.float32))

    def add(self, rows: Int64Array, gradient: Float32Array) -> None:
        """What a view says: rows of the Gaussians with weight, and their gradients, shape (n,)."""
        self.gradient[rows] += gradient
        self.views[rows] += 1.0


def changed_density(
    shapes: Mapping[str, Float32Array],
    seen: Sightings,
    config: DensityConfig,
    extent_m: float,
    rng: np.random.Generator,
) -> Change:
    """Add and remove Gaussians by the configured method; the result is in spatial order.

    Args:
        shapes: Arrays by the names of `SHAPES`.
        seen: What views said of them.
        config: How.
        extent_m: Of the scene.
        rng: Draws places, and who is copied.
    """
    same = Change.none(shapes)
    if config.method == "mcmc":
        changed = _grow(_relocate(same, config, rng), config, rng)
    else:
        changed = _prune(_densify(same, seen, config, extent_m, rng), config, extent_m)
    return changed.select(spatial_order(changed.means_m))


def make_faint(gaussians: Gaussians, rows: BoolArray, config: DensityConfig) -> None:
    """Make some so faint that the next change moves them, or removes them where no budget is kept."""
    limit = 0.5 * config.opacity_min
    gaussians.values["logits"][rows] = np.float32(np.log(limit / (1.0 - limit)))
    gaussians.forget(np.flatnonzero(rows))


def reset_opacities(gaussians: Gaussians, config: DensityConfig) -> None:
    """Make all Gaussians faint; those that are not needed stay faint and are removed."""
    limit = 2.0 * config.opacity_min
    logits = gaussians.values["logits"]
    np.minimum(logits, np.float32(np.log(limit / (1.0 - limit))), out=logits)
    gaussians.first["logits"][:] = 0.0
    gaussians.second["logits"][:] = 0.0


def limit_stretch(gaussians: Gaussians) -> None:
    """Shorten the longest axis of Gaussians that are longer than their middle one times `STRETCH_MAX`."""
    log_scales = gaussians.values["log_scales"]
    a, b, c = log_scales.T
    shorter, longer = np.minimum(a, b), np.maximum(a, b)
    middle = np.maximum(shorter, np.minimum(longer, c))
    np.minimum(log_scales, (middle + np.float32(np.log(STRETCH_MAX)))[:, None], out=log_scales)


def add_noise(gaussians: Gaussians, size_m: float, rng: np.random.Generator) -> None:
    """Move faint Gaussians at random, farther the larger they are.

    Args:
        gaussians: Changed in place.
        size_m: The learning rate of the means times `NOISE`.
        rng: Draws 3 N numbers.
    """
    strength = size_m / (1.0 + np.exp(np.minimum(NOISE_SLOPE * (gaussians.opacities - NOISE_OPACITY), 80.0)))
    noise = rng.standard_normal((len(gaussians), 3), dtype=np.float32)
    rows = np.flatnonzero(strength > 1e-6 * size_m)
    along = _axes(gaussians.values["quats_wxyz"][rows], gaussians.values["log_scales"][rows])
    covariance = along @ along.transpose(0, 2, 1)
    gaussians.values["means_m"][rows] += np.einsum("nij,nj->ni", covariance, noise[rows] * strength[rows, None])


def _axes(quats_wxyz: Float32Array, log_scales: Float32Array) -> Float32Array:
    """Principal axes as columns, as long as the standard deviations [m], shape (n, 3, 3)."""
    import torch

    R: Float32Array = rotations(torch.from_numpy(quats_wxyz)).numpy()
    return R * np.exp(log_scales)[:, None, :]


def _densify(same: Change, seen: Sightings, config: DensityConfig, extent_m: float, rng: np.random.Generator) -> Change:
    """Clone small and split large ones whose projections want to be elsewhere; those with the most of it first."""
    gradient = seen.gradient / np.maximum(seen.views, 1.0)
    room = max(config.count_max - len(same), 0)
    wanted = np.flatnonzero(gradient >= config.gradient_min)
    wanted = np.sort(wanted[np.argsort(-gradient[wanted], kind="stable")[:room]])
    large = same.scales_m[wanted].max(axis=1) > SPLIT_SCALE * extent_m
    split, clone = wanted[large], wanted[~large]
    added = [_sample_copies(same, rows, rng) for rows in (clone, split, split)]
    for part in added[1:]:
        part.log_scales -= np.float32(np.log(_SPLIT_SHRINK))
    keep = np.ones(len(same), dtype=bool)
    keep[split] = False
    return same.select(keep).join(added[0].join(added[1]).join(added[2]))


def _sample_copies(same: Change, rows: Int64Array, rng: np.random.Generator) -> Change:
    """Copies, each at a place drawn from its Gaussian: copies in one place would stay together."""
    copies = same.select(rows)
    copies.fresh[:] = True
    noise = rng.standard_normal((len(rows), 3), dtype=np.float32)
    copies.means_m += np.einsum("nij,nj->ni", _axes(copies.quats_wxyz, copies.log_scales), noise)
    return copies


def _prune(changed: Change, config: DensityConfig, extent_m: float) -> Change:
    small = changed.scales_m.max(axis=1) <= SCALE_MAX * extent_m
    return changed.select(small & (changed.opacities >= config.opacity_min))


def _relocate(same: Change, config: DensityConfig, rng: np.random.Generator) -> Change:
    """Move the faint ones to where others are, which share their opacity with them."""
    opacities = same.opacities
    alive = opacities > config.opacity_min
    dead = np.flatnonzero(~alive)
    if not len(dead) or not alive.any():
        return same
    chosen = _draw_rows(opacities * alive, len(dead), rng)
    _share(same, chosen)
    source = np.arange(len(same))
    source[dead] = chosen
    moved = same.select(source)
    moved.fresh[dead] = True
    return moved


def _grow(changed: Change, config: DensityConfig, rng: np.random.Generator) -> Change:
    """Add copies of some, drawn by opacity, which share their opacity with them."""
    wanted = min(config.count_max, int(np.ceil(len(changed) * (1.0 + config.growth)))) - len(changed)
    if wanted <= 0:
        return changed
    chosen = _draw_rows(changed.opacities, wanted, rng)
    _share(changed, chosen)
    return changed.join(changed.select(chosen))


def _draw_rows(weights: Float32Array, count: int, rng: np.random.Generator) -> Int64Array:
    """Numbers drawn in proportion to weights."""
    ends = np.cumsum(weights, dtype=np.float64)
    chosen: Int64Array = np.searchsorted(ends, rng.random(count) * ends[-1], side="right").clip(max=len(weights) - 1)
    return chosen


def _share(change: Change, chosen: Int64Array) -> None:
    """Make the chosen ones fainter and smaller so that as many copies of them as were drawn look as each did alone."""
    rows, drawn = np.unique(chosen, return_counts=True)
    copies = np.minimum(drawn + 1, _COPIES_MAX)
    opacity, shrink = shared_opacity(change.opacities[rows].astype(np.float64), copies)
    opacity = np.clip(opacity, 0.005, 1.0 - 1e-6)
    change.logits[rows, 0] = np.log(opacity / (1.0 - opacity))
    change.log_scales[rows] += np.log(shrink)[:, None].astype(np.float32)
    change.fresh[rows] = True


def shared_opacity(opacity: Float64Array, copies: Int64Array) -> tuple[Float64Array, Float64Array]:
    """Opacity and factor of size of several Gaussians in one place that together look like one.

    Args:
        opacity: Of the one, shape (n,).
        copies: How many there will be, shape (n,).

    Source: Kheradmand et al., equation 9.
    """
    each = 1.0 - np.power(1.0 - np.minimum(opacity, 1.0 - 1e-9), 1.0 / copies)
    total = np.zeros_like(each)
    for i in range(1, int(copies.max(initial=1)) + 1):
        terms = sum(comb(i - 1, k) * (-1) ** k * np.power(each, k + 1) / np.sqrt(k + 1) for k in range(i))
        total += np.where(i <= copies, terms, 0.0)
    return each, opacity / total
