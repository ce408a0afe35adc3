import numpy as np
import pytest

from readygo.benchmarks.rasterizer import synthetic_room
from readygo.benchmarks.rasterizer.synthetic_room import room_cloud, room_pieces
from readygo.common.gaussians.defects import excessive, unusable


def test_flat_has_exactly_as_many_gaussians_as_asked_and_all_are_sound() -> None:
    cloud = room_cloud(30_001)
    assert len(cloud) == 30_001
    assert cloud.sh_degree == 3
    assert not any(mask.any() for mask in (unusable(cloud) | excessive(cloud)).values())


def test_same_seed_gives_the_same_flat_and_another_seed_another() -> None:
    one, same, other = room_cloud(5000, 3), room_cloud(5000, 3), room_cloud(5000, 4)
    for name in ("means_m", "quats_wxyz", "scales_m", "opacities", "sh"):
        assert np.array_equal(getattr(one, name), getattr(same, name))
        assert not np.array_equal(getattr(one, name), getattr(other, name))


def test_flat_comes_in_bounded_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synthetic_room, "BLOCK", 200)
    sizes = [len(piece) for piece in room_pieces(20_000)]
    assert max(sizes) == 200
    assert sum(sizes) == 20_000


def test_gaussians_shrink_as_their_number_grows() -> None:
    few, many = room_cloud(20_000), room_cloud(80_000)
    assert np.median(few.scales_m.max(axis=1)) == pytest.approx(2 * np.median(many.scales_m.max(axis=1)), rel=0.03)


def test_at_500_000_most_are_flat_and_1_to_4_cm_across() -> None:
    scales = np.sort(np.concatenate([piece.scales_m for piece in room_pieces(500_000)]), axis=1)
    low, high = np.quantile(scales[:, 1:], [0.1, 0.9])
    assert 0.01 < low < high < 0.05
    assert 0.8 < (scales[:, 0] < 0.3 * scales[:, 1]).mean() < 0.95
