"""What changes over a training: the size of images, learning rates, degrees of colour, when Gaussians are added."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.services.reconstructor.training.config import GaussiansConfig

MEANS_RATE = 1.6e-4
"""Rate of the positions, in extents of the scene. Rates are for one view a step (3DGS); a batch of n views multiplies
them by the square root of n."""
_MEANS_END = 0.01
"""Share of `MEANS_RATE` that it falls to."""
SCALES_RATE, QUATS_RATE, OPACITIES_RATE = 5e-3, 1e-3, 5e-2
"""Rates of the logarithms of the scales, of the quaternions and of the logits of the opacities."""
COLOURS_RATE = 2.5e-3
"""Rate of the SH coefficient of degree 0."""
_HIGHER_SHARE = 0.05
"""Coefficients of higher degrees are learned with this share of the rate of the first."""

COARSE, COARSE_END = 4, 0.4
"""Images begin at this fraction of their size, and double until they are whole after this share of the training."""
SH_EVERY = 0.1
"""Another degree of spherical harmonics begins after each such share of the training."""
CHANGE_EVERY = 100
"""Steps between two times that Gaussians are added and removed."""
CHANGE_BEGIN, CHANGE_END = 0.02, 0.5
"""Shares of the training between which Gaussians are added and removed."""
RESET_EVERY = 0.2
"""Opacities are made small after each such share of the training; method `gradients` only."""
TRIM_EVERY = 0.1
"""After each such share of the training, while Gaussians are added, those that few views show are removed."""


@dataclass(frozen=True)
class TrainingSchedule:
    """The plan of a training by its steps, counted from 0."""

    settings: GaussiansConfig
    extent_m: float

    def fraction(self, step: int) -> int:
        """Images are made smaller by this factor: halved from `COARSE` on, in equal times."""
        levels = int(np.log2(COARSE))
        end = COARSE_END * self.settings.steps
        return 1 if step >= end or not levels else COARSE >> int(step / end * levels)

    def sh_degree(self, step: int) -> int:
        """Degree of the spherical harmonics that are drawn."""
        return min(self.settings.sh_degree, int(step / (SH_EVERY * self.settings.steps)))

    def means_rate_m(self, step: int) -> float:
        """Learning rate of the means [m]."""
        return float(MEANS_RATE * self.extent_m * _MEANS_END ** (step / self.settings.steps))

    def rates(self, step: int) -> dict[str, Float32Array]:
        """Learning rates of the columns of each parameter."""
        coefficients = (self.settings.sh_degree + 1) ** 2
        colours = np.full(3 * coefficients, COLOURS_RATE * _HIGHER_SHARE)
        colours[:3] = COLOURS_RATE
        columns = {
            "means_m": np.full(3, self.means_rate_m(step)),
            "quats_wxyz": np.full(4, QUATS_RATE),
            "log_scales": np.full(3, SCALES_RATE),
            "logits": np.full(1, OPACITIES_RATE),
            "sh": colours,
        }
        return {name: column.astype(np.float32) for name, column in columns.items()}

    def changes_density(self, step: int) -> bool:
        """Whether Gaussians are added and removed after this step."""
        steps = self.settings.steps
        return (step + 1) % CHANGE_EVERY == 0 and CHANGE_BEGIN * steps < step + 1 <= CHANGE_END * steps

    def resets_opacities(self, step: int) -> bool:
        """Whether opacities are made small after this step; never in the last of such times before the end."""
        every = max(1, round(RESET_EVERY * self.settings.steps))
        in_time = step + 1 + every <= self.settings.steps * min(1.0, CHANGE_END + RESET_EVERY)
        return self.settings.density.method == "gradients" and (step + 1) % every == 0 and in_time

    def trims(self, step: int) -> bool:
        """Whether Gaussians that hardly any view shows are removed after this step."""
        steps = self.settings.steps
        every = max(1, round(TRIM_EVERY * steps))
        return self.settings.geometry.enabled and (step + 1) % every == 0 and step + 1 <= CHANGE_END * steps
