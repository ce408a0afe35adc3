from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars.importers.archives import read_npz
from readygo.common.errors import AvatarError


def test_plain_arrays_are_read_and_pickled_objects_left_out(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", betas=np.arange(3.0), name=np.array([{"a": 1}], dtype=object))
    arrays = read_npz(tmp_path / "a.npz")
    assert list(arrays) == ["betas"]
    np.testing.assert_array_equal(arrays["betas"], [0.0, 1.0, 2.0])


def test_damaged_archives_are_refused_in_one_line(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", betas=np.random.default_rng(0).normal(size=1000))
    data = (tmp_path / "a.npz").read_bytes()
    for damaged in (b"", b"PK\x03\x04", data[: len(data) // 2], data[:100] + b"\xff" * 64 + data[164:]):
        (tmp_path / "b.npz").write_bytes(damaged)
        with pytest.raises(AvatarError, match="not a readable NumPy archive") as raised:
            read_npz(tmp_path / "b.npz")
        assert "\n" not in str(raised.value)
