from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import RunError
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.state_simulation.bank import EpisodeBank, join_banks, load_bank, make_bank
from readygo.common.state_simulation.goal_distances import GoalDistances


def make(count: int, rows: int, first: int = 0) -> EpisodeBank:
    walks = np.arange(count * rows * 4, dtype=np.float32).reshape(count, rows, 2, 2)
    return EpisodeBank(
        index=np.arange(first, first + count),
        start_xyyaw=np.zeros((count, 3)),
        goal_xy_m=np.ones((count, 2)),
        human_count=np.full(count, 2),
        walks_m=walks,
        fields_cm=np.zeros((count, 3, 4), np.uint16),
    )


def test_bank_comes_back_from_its_file_and_damage_is_said(tmp_path: Path) -> None:
    bank, path = make(3, 5), tmp_path / "bank.npz"
    bank.save(path)
    loaded = load_bank(path)
    assert len(loaded) == 3
    assert np.array_equal(loaded.walks_m, bank.walks_m)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(RunError, match="it is made again"):
        load_bank(path)


def test_people_who_arrive_early_stay_there_in_a_longer_bank() -> None:
    short, long = make(2, 3), make(1, 6, first=2)
    joined = join_banks([short, long])
    assert joined.index.tolist() == [0, 1, 2]
    assert joined.walks_m.shape == (3, 6, 2, 2)
    assert np.array_equal(joined.walks_m[:2, 5], short.walks_m[:, 2])
    assert joined.first(1).index.tolist() == [0]


def test_bank_without_episodes_has_the_shapes_of_others_and_comes_back(tmp_path: Path) -> None:
    occupied = np.zeros((61, 41), np.bool_)
    room = OccupancyMap(frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.05), occupied=occupied)
    distances = GoalDistances(room, 0.3)
    assert distances.to_goal_cm((1.0, 1.0)).shape == distances.shape == (31, 21)
    make_bank([], distances, 6).save(tmp_path / "bank.npz")
    bank = load_bank(tmp_path / "bank.npz")
    assert len(bank) == 0
    assert (bank.start_xyyaw.shape, bank.goal_xy_m.shape, bank.human_count.shape) == ((0, 3), (0, 2), (0,))
    assert (bank.walks_m.shape, bank.fields_cm.shape) == ((0, 1, 6, 2), (0, 31, 21))
    assert (bank.walks_m.dtype, bank.fields_cm.dtype) == (np.float32, np.uint16)
