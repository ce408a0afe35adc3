"""The floor is found where soles stand, in a world that does not stand upright, and floating and slipping cost."""

import numpy as np
import pytest
import torch

from readygo.services.reconstructor.avatars.contacts import (
    LEVEL_FLOOR,
    Floor,
    find_contacts,
    find_floor,
    lift_cost,
    settle_floor,
    slip_cost,
    sole_offsets,
    standing_share,
    sunk_cost,
    unknown_lift_cost,
)

FRAMES = 41
TILT = np.array([0.05, -0.03])


def _walk(rng: np.random.Generator | None = None) -> torch.Tensor:
    """Soles in a walk along x: those of a side stand for ten frames, then swing, shape (F, 4, 3)."""
    soles = np.zeros((FRAMES, 4, 3))
    for side in range(2):
        for frame in range(FRAMES):
            cycle, within = divmod(frame + 10 * side, 20)
            swing = max(within - 10, 0) / 10.0
            step = [1.0 * (cycle + swing), 0.2 * side + 0.3 * np.sin(0.1 * frame), 0.25 * np.sin(np.pi * swing)]
            if swing == 0.0:
                step[1] = 0.2 * side + 0.3 * cycle
            for sole in (side, side + 2):
                soles[frame, sole] = (step[0] + 0.1 * (sole > 1), step[1], step[2])
    if rng is not None:
        soles += rng.normal(0.0, 0.002, soles.shape)
    return torch.from_numpy(soles)


def test_floor_is_found_though_the_world_is_tilted() -> None:
    soles = _walk(np.random.default_rng(0)).numpy()
    normal = np.array([*TILT, 1.0]) / np.linalg.norm([*TILT, 1.0])
    soles[..., 2] += 0.4 - soles[..., :2] @ TILT
    soles[:, 2:, 2] += 0.02
    floor = find_floor(torch.from_numpy(soles), np.array([0.0, 0.0, 1.0]))
    assert floor is not None
    assert np.rad2deg(np.arccos(floor.up @ normal)) < 0.7
    moved = torch.from_numpy(soles)
    standing = standing_share(find_contacts(moved, floor)) == 1.0
    assert standing.sum() > FRAMES
    assert float(floor.heights(moved)[standing].abs().mean()) < 0.006


def test_no_floor_where_nothing_stands() -> None:
    soles = torch.cumsum(torch.full((20, 4, 3), 0.1, dtype=torch.float64), dim=0)
    assert find_floor(soles, np.array([0.0, 0.0, 1.0])) is None


def test_soles_that_stand_are_low_and_slow() -> None:
    contacts = find_contacts(_walk(), LEVEL_FLOOR)
    assert contacts.shape == (FRAMES - 1, 4)
    assert contacts[1:8, 0].all()
    assert not contacts[12:18, 0].any()
    assert contacts[11:18, 1].all()
    share = standing_share(contacts)
    assert share.shape == (FRAMES, 4)
    assert share[5, 0] == 1.0
    assert share[0, 0] == 0.5


def test_floor_is_where_soles_stand_in_the_mean() -> None:
    """One that is found again and again does not move feet up or down."""
    soles = _walk(np.random.default_rng(1))
    high = Floor(up=LEVEL_FLOOR.up, heights_m=np.full(4, 0.01))
    contacts = find_contacts(soles, high)
    floor = settle_floor(soles, contacts, high)
    standing = standing_share(contacts)
    for soles_of_kind in (slice(0, 2), slice(2, 4)):
        over = (floor.heights(soles) * standing)[:, soles_of_kind].sum() / standing[:, soles_of_kind].sum()
        assert float(over) == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(settle_floor(soles, contacts, floor).heights_m, floor.heights_m, atol=1e-12)


def test_costs_count_standing_soles_in_deviations() -> None:
    heights = torch.tensor([[0.01, 0.3, -0.02, 0.0]], dtype=torch.float64)
    standing = torch.tensor([[1.0, 0.0, 0.0, 1.0]], dtype=torch.float64)
    assert float(lift_cost(heights, standing)) == pytest.approx(1.0)
    assert float(sunk_cost(heights)) == pytest.approx(1.0)
    assert float(unknown_lift_cost(heights)) == pytest.approx(4.0 / (1.0 + 4.0 / 25.0))
    moved = torch.tensor([[[0.006, 0.0, 0.0], [0.006, 0.0, 0.0]]], dtype=torch.float64)
    contacts = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
    assert float(slip_cost(moved, contacts)) == pytest.approx(1.0 / (1.0 + 1.0 / 25.0))
    assert float(slip_cost(1000.0 * moved, contacts)) < 25.0


def test_soles_are_below_their_joints() -> None:
    tpose = np.zeros((24, 3))
    tpose[[7, 8], 1], tpose[[10, 11], 1] = 0.09, 0.03
    np.testing.assert_allclose(sole_offsets(tpose, 0.01)[:, 1], [-0.08, -0.08, -0.02, -0.02])
