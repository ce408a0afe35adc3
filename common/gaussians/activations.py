"""The maps between stored and physical numbers of a Gaussian: logit and opacity, log and scale.

NumPy's vectorised exp and log round differently on AVX2 and AVX-512 machines, which would leak into recorded images;
these loops call the scalar functions, in float64, and round once.
"""

import math

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.kernels import kernel_with_cache

LOGIT_LIMIT = 40.0
"""Stored logits stay within +-40, where the opacity is 0 or 1 to float32."""
SCALE_MIN_M = 1e-20
"""Smallest scale whose logarithm is stored."""


@kernel_with_cache
def _exp(x: Float32Array, out: Float32Array) -> None:
    for i in range(x.size):
        out[i] = math.exp(x[i])


@kernel_with_cache
def _log(x: Float32Array, minimum: float, out: Float32Array) -> None:
    for i in range(x.size):
        out[i] = math.log(max(float(x[i]), minimum))


@kernel_with_cache
def _sigmoid(x: Float32Array, out: Float32Array) -> None:
    for i in range(x.size):
        out[i] = 1.0 / (1.0 + math.exp(-x[i]))


@kernel_with_cache
def _logit(p: Float32Array, limit: float, out: Float32Array) -> None:
    for i in range(p.size):
        if p[i] <= 0.0:
            out[i] = -limit
        elif p[i] >= 1.0:
            out[i] = limit
        else:
            out[i] = math.log(p[i] / (1.0 - p[i]))


def scales_from_logs(log_scales: Float32Array) -> Float32Array:
    """Scales of stored log scales, any shape; too large ones become inf."""
    stored = np.minimum(np.ascontiguousarray(log_scales, dtype=np.float32), np.float32(200.0))
    out = np.empty_like(stored)
    _exp(stored.reshape(-1), out.reshape(-1))
    return out


def logs_from_scales(scales_m: Float32Array) -> Float32Array:
    """Log scales to store, any shape."""
    scales_m = np.ascontiguousarray(scales_m, dtype=np.float32)
    out = np.empty_like(scales_m)
    _log(scales_m.reshape(-1), SCALE_MIN_M, out.reshape(-1))
    return out


def opacities_from_logits(logits: Float32Array) -> Float32Array:
    """Opacities 0..1 of stored logits, any shape."""
    stored = np.clip(np.ascontiguousarray(logits, dtype=np.float32), -LOGIT_LIMIT, LOGIT_LIMIT)
    out = np.empty_like(stored)
    _sigmoid(stored.reshape(-1), out.reshape(-1))
    return out


def logits_from_opacities(opacities: Float32Array) -> Float32Array:
    """Logits to store, any shape."""
    opacities = np.ascontiguousarray(opacities, dtype=np.float32)
    out = np.empty_like(opacities)
    _logit(opacities.reshape(-1), LOGIT_LIMIT, out.reshape(-1))
    return out
