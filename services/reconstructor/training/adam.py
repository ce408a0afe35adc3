"""Adam for the Gaussians that a step's views have seen; the others, and their state, stay as they are.

Source: Kingma & Ba, Adam, 2015; selective as in Mallick et al., Taming 3DGS, 2024. With B views a step the rates and
betas are those of Malladi et al., On the SDEs and Scaling Rules for Adaptive Gradient Algorithms, 2022.
"""

import math
from collections.abc import Sequence

import numpy as np

from readygo.common.arrays import Float32Array, Int32Array
from readygo.common.kernels import kernel_with_cache
from readygo.services.reconstructor.training.parameters import PARAMETERS, Gaussians

_BETAS = (0.9, 0.999)
EPSILON = 1e-15


class Adam:
    """The optimiser of a training."""

    def __init__(self, steps: int, batch: int) -> None:
        """Prepare the corrections of moments that begin at zero.

        Args:
            steps: At most so many are taken.
            batch: Views a step.
        """
        beta1, beta2 = self.betas = tuple(max(1.0 - batch * (1.0 - beta), 0.0) for beta in _BETAS)
        self.rate = math.sqrt(batch)
        """Factor of the learning rates."""
        count = np.arange(1, steps + 2, dtype=np.float64)
        correction = np.sqrt(1.0 - beta2**count) / (1.0 - beta1**count)
        self.corrections: Float32Array = np.concatenate([[1.0], correction]).astype(np.float32)
        """Corrections of the moments by the number of updates, shape (steps + 2,)."""

    def step(
        self,
        gaussians: Gaussians,
        gradients: Sequence[dict[str, Float32Array]],
        places: Int32Array,
        rates: dict[str, Float32Array],
        part: slice,
    ) -> None:
        """Change the Gaussians of `part` that some view has a gradient of; parts may be changed side by side.

        Args:
            gaussians: Changed in place.
            gradients: Of each view, by parameter: rows of some of the Gaussians, shape (n, K).
            places: Which of a view's rows is that of a Gaussian; -1: none, shape (B, N).
            rates: Learning rates of the columns of each parameter, shape (K,).
            part: Which Gaussians.
        """
        begin, end = part.start, part.stop
        gaussians.updates[begin:end] += (places[:, begin:end] >= 0).any(axis=0)
        beta1, beta2 = self.betas
        for name in PARAMETERS:
            _step(
                gaussians.values[name],
                gaussians.first[name],
                gaussians.second[name],
                tuple(each[name] for each in gradients),
                places,
                gaussians.updates,
                self.corrections,
                (rates[name] * self.rate).astype(np.float32),
                np.float32(beta1),
                np.float32(beta2),
                begin,
                end,
            )


@kernel_with_cache(error_model="numpy", nogil=True)
def _step(
    values: Float32Array,
    first: Float32Array,
    second: Float32Array,
    gradients: tuple[Float32Array, ...],
    places: Int32Array,
    updates: Float32Array,
    corrections: Float32Array,
    rates: Float32Array,
    beta1: np.float32,
    beta2: np.float32,
    begin: int,
    end: int,
) -> None:
    width = values.shape[1]
    slope = np.empty(width, dtype=np.float32)
    one, epsilon = np.float32(1), np.float32(EPSILON)
    for n in range(begin, end):
        slope[:] = 0.0
        used = False
        for view in range(len(gradients)):
            place = places[view, n]
            if place >= 0:
                used = True
                row = gradients[view][place]
                for k in range(width):
                    slope[k] += row[k]
        if not used:
            continue
        correction = corrections[int(updates[n])]
        value, mean, square = values[n], first[n], second[n]
        for k in range(width):
            g = slope[k]
            mean[k] = beta1 * mean[k] + (one - beta1) * g
            square[k] = beta2 * square[k] + (one - beta2) * g * g
            value[k] -= rates[k] * correction * mean[k] / (np.sqrt(square[k]) + epsilon)
