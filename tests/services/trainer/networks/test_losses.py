"""The published losses: what counts, and what does not."""

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.networks.models import Nomad  # noqa: E402
from readygo.services.trainer.networks import losses  # noqa: E402
from readygo.services.trainer.networks.samples import NetworkBatch  # noqa: E402


def batch(*distances: float, other: bool = False, places: int = 5) -> NetworkBatch:
    count = len(distances)
    return NetworkBatch(
        images=torch.zeros(count, 4, 3, 96, 96),
        goals=torch.zeros(count, 3, 96, 96),
        distances=torch.tensor(distances),
        places=torch.zeros(count, places, 4),
        other=torch.full((count,), other),
    )


class Off:
    """Names places that are one unit off, and the distance 0."""

    def predict(self, images, goals):
        return torch.zeros(len(images)), torch.ones(len(images), 5, 4)


def loss(name: str, of: NetworkBatch) -> float:
    return float(losses.loss_of(name, Off(), of, torch.Generator()))  # type: ignore[arg-type]


def test_distance_and_places_are_weighed_as_published() -> None:
    assert loss("gnm", batch(4.0)) == pytest.approx(0.5e-2 * 16 + 0.5 * 1 / 1.01)
    assert loss("vint", batch(1.0)) == pytest.approx(0.5e-2 + 0.5 / 1.01)


def test_places_do_not_count_where_the_goal_is_near_far_or_elsewhere() -> None:
    assert loss("gnm", batch(2.0)) == pytest.approx(0.5e-2 * 4)
    assert loss("vint", batch(10.0)) == pytest.approx(0.5)
    assert loss("gnm", batch(4.0, other=True)) == pytest.approx(0.5e-2 * 16)


class Denoiser(torch.nn.Module):
    """Sees the noise at once."""

    def __init__(self, answer: float) -> None:
        super().__init__()
        self.answer, self.steps = answer, []

    def forward(self, sample, step, condition):
        self.steps += step.tolist()
        return torch.full_like(sample, self.answer)


def nomad(answer: float) -> Nomad:
    network = Nomad.__new__(Nomad)
    torch.nn.Module.__init__(network)
    network.vision_encoder = lambda images, goals, hidden: torch.zeros(len(images), 256)
    network.noise_pred_net = Denoiser(answer)
    network.dist_pred_net = lambda condition: torch.zeros(len(condition))
    return network


def test_nomad_learns_the_noise_of_every_step() -> None:
    network = nomad(0.0)
    of = batch(*[8.0] * 400, places=8)
    value = float(losses.loss_of("nomad", network, of, torch.Generator().manual_seed(0)))
    assert set(network.noise_pred_net.steps) == set(range(10))
    # Noise of variance one that is not seen, and squared distances in the half of the samples that see their goal.
    assert value == pytest.approx(1.0, abs=0.1)
    assert float(losses.loss_of("nomad", nomad(3.0), of, torch.Generator().manual_seed(0))) == pytest.approx(10, abs=1)
