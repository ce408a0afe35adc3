"""Gains and offsets of photos: what exposure and white balance made of each of them."""

from collections.abc import Sequence

import numpy as np

from readygo.common.arrays import Float32Array


class Exposures:
    """Gain and offset of every colour of every photo, and how they are learned."""

    def __init__(self, values: Float32Array, moments: Float32Array) -> None:
        """Start from given exposures and moments.

        Args:
            values: Logarithms of the gains, and offsets, shape (V, 2, 3).
            moments: Adam's first and second moments of them, shape (2, V, 2, 3).
        """
        self.values, self.moments = values, moments

    @classmethod
    def none(cls, count: int) -> "Exposures":
        """Neutral exposures of `count` photos: gains of 1, offsets of 0."""
        return cls(np.zeros((count, 2, 3), dtype=np.float32), np.zeros((2, count, 2, 3), dtype=np.float32))

    def step(
        self, numbers: Sequence[int], gradients: Sequence[Float32Array], rate: float, train: Sequence[int]
    ) -> None:
        """Adam without corrections; gains and offsets of all images have no common part, which colours could hold.

        Args:
            numbers: Numbers of the photos that were drawn; one may have been drawn twice.
            gradients: Gradients by each photo's exposure, shape (2, 3).
            rate: Learning rate.
            train: Numbers of the photos that are trained on.
        """
        first, second = self.moments
        for number, gradient in zip(numbers, gradients, strict=True):
            first[number] += 0.1 * (gradient - first[number])
            second[number] += 0.001 * (np.square(gradient) - second[number])
            step = first[number] / (np.sqrt(second[number]) + 1e-15)
            self.values[number] -= np.float32(rate) * step
        self.values[list(train)] -= self.values[list(train)].mean(axis=0)
