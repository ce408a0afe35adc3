import numpy as np
import pytest

from readygo.apps.export.statistics import merged, of_images, of_rows
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import jpeg


def test_merged_statistics_are_those_of_all_rows() -> None:
    rows = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    parts = [{"a": of_rows(rows[:10])}, {"a": of_rows(rows[10:])}]
    both, whole = merged(parts)["a"], of_rows(rows)
    for name in ("min", "max", "mean", "std"):
        np.testing.assert_allclose(both[name], whole[name], rtol=1e-9)
    assert both["count"] == [50]
    assert set(both) == {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}


def test_colours_are_shares_per_channel() -> None:
    found = of_images([jpeg(number) for number in range(20)])
    assert np.array(found["mean"]).shape == (3, 1, 1)
    assert 0.4 < np.mean(found["mean"]) < 0.6
    assert found["count"] == [8]


def test_damaged_image_is_said() -> None:
    with pytest.raises(DatasetError, match="damaged"):
        of_images([b"nothing"])
