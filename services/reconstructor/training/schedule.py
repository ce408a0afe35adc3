"""What changes over a training: the size of images, learning rates, degrees of colour, when Gaussians are added."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.services.reconstructor.training.config import GaussiansConfig

_MEANS_END = 0.01
_HIGHER_SHARE = 0.05
"""Coefficients of higher degrees are learned with this share of the rate of the first."""


@dataclass(frozen=True)
class Schedule:
    """The plan of a training by its steps, counted from 0."""

    settings: GaussiansConfig
    extent_m: float

    def fraction(self, step: int) -> int:
        """Images are made smaller by this factor: halved from `coarse` on, in equal times."""
        levels = int(np.log2(self.settings.coarse))
        end = self.settings.coarse_end * self.settings.steps
        return 1 if step >= end or not levels else self.settings.coarse >> int(step / end * levels)

    def sh_degree(self, step: int) -> int:
        """Degree of the spherical harmonics that are drawn."""
        return min(self.settings.sh_degree, int(step / (self.settings.sh_every * self.settings.steps)))

    def means_rate_m(self, step: int) -> float:
        """Learning rate of the means [m]."""
        return float(self.settings.rates.means * self.extent_m * _MEANS_END ** (step / self.settings.steps))

    def rates(self, step: int) -> dict[str, npt.NDArray[np.float32]]:
        """Learning rates of the columns of each parameter."""
        rates, coefficients = self.settings.rates, (self.settings.sh_degree + 1) ** 2
        colours = np.full(3 * coefficients, rates.colours * _HIGHER_SHARE)
        colours[:3] = rates.colours
        columns = {
            "means_m": np.full(3, self.means_rate_m(step)),
            "quats_wxyz": np.full(4, rates.quats),
            "log_scales": np.full(3, rates.scales),
            "logits": np.full(1, rates.opacities),
            "sh": colours,
        }
        return {name: column.astype(np.float32) for name, column in columns.items()}

    def changes_density(self, step: int) -> bool:
        """Whether Gaussians are added and removed after this step."""
        density, steps = self.settings.density, self.settings.steps
        return (step + 1) % density.every == 0 and density.begin * steps < step + 1 <= density.end * steps

    def resets_opacities(self, step: int) -> bool:
        """Whether opacities are made small after this step; never in the last of such times before the end."""
        density = self.settings.density
        every = max(1, round(density.reset_every * self.settings.steps))
        in_time = step + 1 + every <= self.settings.steps * min(1.0, density.end + density.reset_every)
        return density.method == "gradients" and (step + 1) % every == 0 and in_time

    def trims(self, step: int) -> bool:
        """Whether Gaussians that hardly any view shows are removed after this step."""
        geometry, steps = self.settings.geometry, self.settings.steps
        every = max(1, round(geometry.trim_every * steps))
        return geometry.enabled and (step + 1) % every == 0 and step + 1 <= self.settings.density.end * steps
