"""The published losses.

Source: Shah et al., GNM (ICRA 2023) and ViNT (CoRL 2023); Sridhar et al., NoMaD (ICRA 2024), with the weights of their
training configurations.
"""

import torch
from torch.nn import functional

from readygo.common.networks.models import NOMAD_WAYPOINTS, WAYPOINTS, Gnm, Nomad, Vint, steps_of_places
from readygo.common.networks.unet import Ddpm
from readygo.services.trainer.networks.samples import NetworkBatch

NEAR = {"gnm": (2, 10), "vint": (0, 10), "nomad": (3, 20)}
"""Actions count in samples whose goal is more than so many looks away, and less than so many."""
PLACES = {"gnm": WAYPOINTS, "vint": WAYPOINTS, "nomad": NOMAD_WAYPOINTS}
"""Places that a network names."""
DISTANCE_SHARE, DISTANCE_SCALE = 0.5, 1e-2
"""Share of the distance in the loss of GNM and ViNT, and what its square is scaled by."""
NOMAD_DISTANCE_SHARE = 1e-4
GOAL_HIDDEN = 0.5
"""Share of NoMaD's samples that do not see their goal."""
_NONE = 1e-2
"""Keeps the mean over no sample finite."""


def loss_of(name: str, network: Gnm | Vint | Nomad, batch: NetworkBatch, generator: torch.Generator) -> torch.Tensor:
    """The loss of a batch.

    Args:
        name: Which network.
        network: In training.
        batch: Samples, with as many places as `PLACES` says.
        generator: Draws what is hidden and the noise of NoMaD.
    """
    if isinstance(network, Nomad):
        return _nomad_loss(network, batch, generator)
    distances, places = network.predict(batch.images, batch.goals)
    distance = functional.mse_loss(distances, batch.distances)
    action = (places - batch.places).square().mean(dim=(1, 2))
    return DISTANCE_SHARE * DISTANCE_SCALE * distance + (1 - DISTANCE_SHARE) * _mean(action, _near(name, batch))


def _nomad_loss(network: Nomad, batch: NetworkBatch, generator: torch.Generator) -> torch.Tensor:
    """Noise in the steps, and the distance where the goal is seen."""
    count, ddpm = len(batch.images), Ddpm()
    hidden = torch.rand(count, generator=generator) < GOAL_HIDDEN
    condition = network.vision_encoder(batch.images, batch.goals, hidden)
    distance = (network.dist_pred_net(condition) - batch.distances).square()
    steps = steps_of_places(batch.places[..., :2])
    noise = torch.randn(steps.shape, generator=generator)
    level = torch.randint(len(ddpm.betas), (count,), generator=generator)
    predicted = network.noise_pred_net(ddpm.add_noise(steps, noise, level), level, condition)
    action = (predicted - noise).square().mean(dim=(1, 2))
    share = NOMAD_DISTANCE_SHARE
    return share * _mean(distance, ~hidden) + (1 - share) * _mean(action, _near("nomad", batch))


def _near(name: str, batch: NetworkBatch) -> torch.Tensor:
    low, high = NEAR[name]
    return (batch.distances > low) & (batch.distances < high) & ~batch.other


def _mean(values: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    return (values * counts).mean() / (counts.float().mean() + _NONE)
