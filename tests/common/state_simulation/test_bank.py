from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import RunError
from readygo.common.state_simulation.bank import EpisodeBank, join_banks, load_bank


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
