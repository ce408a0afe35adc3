"""What perception is trained by: where people are on its map, how they move, and how far the way is free.

Presence: the focal loss of key points, alpha = 2, beta = 4, over cells c with target Y_c, 1 at a human and falling off
as a Gaussian around it, and probability p_c, per human:

    -sum_c (1 - p_c)^2 log p_c where Y_c = 1,  -(1 - Y_c)^4 p_c^2 log(1 - p_c) elsewhere

Everything else: the negative log-likelihood of a Laplace distribution, whose width b is learned too:

    |error| / b + log b

Sources: Zhou, Wang and Kraehenbuehl, Objects as Points, 2019; Kendall and Gal, What uncertainties do we need in
Bayesian deep learning for computer vision?, 2017.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.perception.grid import FAR_M, NEAR_M, PolarGrid

HEAT_SD = (0.9, 0.9)
"""Standard deviation of a target around a human, in rings and columns."""
TAUGHT_HEAT = 0.25
"""Cells with at least this target learn place and velocity of their human."""
PEOPLE_WEIGHT, RAYS_WEIGHT, VALUES_WEIGHT = 1.0, 0.5, 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Targets:
    """What the maps of N images shall be."""

    heat: Float32Array
    """Target of presence, 1 at humans, shape (N, D, C)."""
    peak: BoolArray
    """True at the cell of each human, shape (N, D, C)."""
    values: Float32Array
    """Offsets of bearing [rad] and of the logarithm of the distance from the cell's, velocities along and to the left
    of the line of sight [m/s], of the human of the cell, shape (N, 4, D, C); NaN where nothing is taught."""
    rays_log_m: Float32Array
    """Logarithms of the free distances [m], shape (N, C)."""


def targets_of(people: Float32Array, visible: BoolArray, rays_m: Float32Array, grid: PolarGrid) -> Targets:
    """The targets of some labels, see `PerceptionLabels`."""
    count, rings, columns = len(people), len(grid.distances_m), len(grid.bearings_rad)
    heat = np.zeros((count, rings, columns), np.float32)
    peak = np.zeros((count, rings, columns), np.bool_)
    values = np.full((count, 4, rings, columns), np.nan, np.float32)
    log_m = np.log(grid.distances_m)
    for n, m in np.argwhere(visible).tolist():
        bearing, distance_m, along, across = people[n, m].tolist()
        log_distance = math.log(min(max(distance_m, NEAR_M), FAR_M))
        ring = min(max((log_distance - log_m[0]) / grid.ring_step, 0.0), rings - 1.0)
        column = float(np.interp(-bearing, -grid.bearings_rad, np.arange(columns)))
        blob = _blob(ring, column, rings, columns)
        nearer = blob > heat[n]
        heat[n] = np.maximum(heat[n], blob)
        peak[n, round(ring), round(column)] = True
        taught = nearer & (blob >= TAUGHT_HEAT)
        values[n, 0][taught] = (bearing - grid.bearings_rad[None, :]).repeat(rings, axis=0)[taught]
        values[n, 1][taught] = (log_distance - log_m[:, None]).repeat(columns, axis=1)[taught]
        values[n, 2][taught], values[n, 3][taught] = along, across
    return Targets(heat=heat, peak=peak, values=values, rays_log_m=np.log(np.maximum(rays_m, 0.05)))


def perception_loss(people: Tensor, free: Tensor, targets: tuple[Tensor, Tensor, Tensor, Tensor]) -> Tensor:
    """The loss of a batch.

    Args:
        people: Maps of `PerceptionNet`, shape (B, 9, D, C).
        free: Free distances of `PerceptionNet`, shape (B, 2, C).
        targets: Heat, peak, values and rays as of `Targets`.
    """
    heat, peak, values, rays = targets
    logits = people[:, 0]
    p = torch.sigmoid(logits)
    log_p, log_q = torch.nn.functional.logsigmoid(logits), torch.nn.functional.logsigmoid(-logits)
    focal = torch.where(peak, -((1 - p) ** 2) * log_p, -((1 - heat) ** 4) * p**2 * log_q)
    presence = focal.sum() / peak.sum().clamp(min=1)
    taught = torch.isfinite(values)
    error = (people[:, 1:5] - values.nan_to_num()).abs()
    weight = heat[:, None] * taught
    told = ((error * torch.exp(-people[:, 5:]) + people[:, 5:]) * weight).sum() / weight.sum().clamp(min=1)
    way = (free[:, 0] - rays).abs() * torch.exp(-free[:, 1]) + free[:, 1]
    return PEOPLE_WEIGHT * presence + VALUES_WEIGHT * 4 * told + RAYS_WEIGHT * way.mean()


def _blob(ring: float, column: float, rings: int, columns: int) -> Float64Array:
    """A Gaussian around the cell that a place falls into, 1 at that cell, shape (D, C)."""
    a = (np.arange(rings) - round(ring)) / HEAT_SD[0]
    b = (np.arange(columns) - round(column)) / HEAT_SD[1]
    blob: Float64Array = np.exp(-0.5 * (a[:, None] ** 2 + b[None, :] ** 2))
    return blob
