import numpy as np
import pytest
import torch

from readygo.common.perception.grid import SHAPE, polar_grid
from readygo.common.perception.people import CHANNELS
from readygo.services.trainer.perception.labels import PEOPLE_MAX
from readygo.services.trainer.perception.loss import perception_loss, targets_of
from tests.services.trainer.perception.conftest import CAMERA

GRID = polar_grid(CAMERA)


def one(bearing: float, distance_m: float, *, visible: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    people = np.full((1, PEOPLE_MAX, 4), np.nan, np.float32)
    people[0, 0] = bearing, distance_m, 1.0, -0.5
    shown = np.zeros((1, PEOPLE_MAX), np.bool_)
    shown[0, 0] = visible
    return people, shown, np.full((1, SHAPE[1]), 2.0, np.float32)


def test_target_is_at_the_cell_of_the_human_and_its_values_lead_back_to_it() -> None:
    targets = targets_of(*one(0.3, 2.5), GRID)
    ((_, ring, column),) = np.argwhere(targets.peak).tolist()
    assert abs(GRID.bearings_rad[column] - 0.3) < 0.04
    assert abs(np.log(GRID.distances_m[ring] / 2.5)) <= GRID.ring_step / 2
    assert targets.heat[0, ring, column] == 1.0
    taught = np.isfinite(targets.values[0, 0])
    bearings = np.broadcast_to(GRID.bearings_rad, SHAPE)[taught] + targets.values[0, 0][taught]
    log_m = np.broadcast_to(np.log(GRID.distances_m)[:, None], SHAPE)[taught] + targets.values[0, 1][taught]
    assert bearings == pytest.approx(np.full(taught.sum(), 0.3), abs=1e-6)
    assert np.exp(log_m) == pytest.approx(np.full(taught.sum(), 2.5), rel=1e-5)
    assert set(targets.values[0, 2][taught].tolist()) == {1.0}
    assert set(targets.values[0, 3][taught].tolist()) == {-0.5}


def test_hidden_human_is_nothing_to_learn() -> None:
    targets = targets_of(*one(0.3, 2.5, visible=False), GRID)
    assert not targets.peak.any()
    assert np.isnan(targets.values).all()


def tensors(targets: object) -> tuple[torch.Tensor, ...]:
    names = ("heat", "peak", "values", "rays_log_m")
    return tuple(torch.from_numpy(getattr(targets, name)) for name in names)


def answers(targets: object, certain: float = 6.0) -> tuple[torch.Tensor, torch.Tensor]:
    """What would be right."""
    people = torch.zeros(1, CHANNELS, *SHAPE)
    _, peak, values, rays = tensors(targets)
    people[:, 0] = torch.where(peak, certain, -certain)
    people[:, 1:5] = values.nan_to_num()
    return people, torch.stack([rays, torch.zeros_like(rays)], dim=1)


def test_right_answers_cost_less_than_wrong_ones() -> None:
    targets = targets_of(*one(0.3, 2.5), GRID)
    people, free = answers(targets)
    right = perception_loss(people, free, tensors(targets))  # type: ignore[arg-type]
    for channel, change in ((0, -12.0), (1, 0.5), (2, 0.5), (3, 1.0), (4, -1.0)):
        wrong = people.clone()
        wrong[:, channel] += change * (torch.from_numpy(targets.peak) if channel == 0 else 1.0)
        assert perception_loss(wrong, free, tensors(targets)) > right + 0.1  # type: ignore[arg-type]
    assert perception_loss(people, free + torch.tensor([1.0, 0.0])[:, None], tensors(targets)) > right + 0.1  # type: ignore[arg-type]


def test_loss_without_people_is_finite() -> None:
    people, shown, rays = one(0.3, 2.5, visible=False)
    targets = targets_of(people, shown, rays, GRID)
    maps = torch.zeros(1, CHANNELS, *SHAPE, requires_grad=True)
    loss = perception_loss(maps, torch.zeros(1, 2, SHAPE[1]), tensors(targets))  # type: ignore[arg-type]
    loss.backward()
    assert torch.isfinite(loss)
    assert torch.isfinite(maps.grad).all()  # type: ignore[arg-type]
