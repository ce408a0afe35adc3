"""SMPL model files are read without running anything, as the body that they hold."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.avatars.importers import load_smpl_model
from readygo.common.errors import AvatarError
from tests.common.avatars.importers.humans import (
    smpl_entries,
    tpose_joints_m,
    write_smpl_npz,
    write_smpl_pickle,
)


@pytest.mark.parametrize("protocol", [0, 1, 2, 4])
def test_old_pickle_with_chumpy_and_sparse_arrays_is_read(tmp_path: Path, protocol: int) -> None:
    model = load_smpl_model(write_smpl_pickle(tmp_path / "SMPL.pkl", protocol=protocol))
    entries = smpl_entries()
    np.testing.assert_array_equal(model.vertices_m, entries["v_template"])
    np.testing.assert_array_equal(model.weights, entries["weights"])
    np.testing.assert_array_equal(model.faces, entries["f"])
    np.testing.assert_allclose(model.joints_m, tpose_joints_m(), atol=1e-12)


def test_archive_and_pickle_hold_the_same_model(tmp_path: Path) -> None:
    one, other = (
        load_smpl_model(write_smpl_npz(tmp_path / "a.npz")),
        load_smpl_model(write_smpl_pickle(tmp_path / "a.pkl")),
    )
    np.testing.assert_array_equal(one.vertices_m, other.vertices_m)
    np.testing.assert_allclose(one.joints_m, other.joints_m, atol=1e-12)


def test_betas_change_vertices_and_joints(tmp_path: Path) -> None:
    path = write_smpl_pickle(tmp_path / "SMPL.pkl")
    larger = load_smpl_model(path, betas=[1.0])
    np.testing.assert_allclose(larger.joints_m, 1.1 * tpose_joints_m(), atol=1e-12)
    with pytest.raises(AvatarError, match="2 shape directions, but 3 betas"):
        load_smpl_model(path, betas=[1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "data", [b"", b"\x80\x02", b"(dp0\n", b"\x80\x04\x95\xff\xff\xff\xff", b"\x80\x02}q\x00.", b"cx\n"]
)
def test_broken_pickles_are_refused_in_one_line(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x.pkl").write_bytes(data)
    with pytest.raises(AvatarError) as raised:
        load_smpl_model(tmp_path / "x.pkl")
    assert "\n" not in str(raised.value)


def test_missing_keys_are_named(tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="lacks weights, J_regressor"):
        load_smpl_model(write_smpl_pickle(tmp_path / "x.pkl", drop=("weights", "J_regressor")))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("weights", np.zeros((5, 24)), "weights must be .* x 24, got"),
        ("v_template", np.full((632, 3), np.nan), "v_template holds values that are not finite"),
        ("J_regressor", np.zeros((24, 7)), "J_regressor must be"),
        (
            "kintree_table",
            np.zeros((2, 55), np.int64),
            "has 55 joints: it is SMPL-X. Give a SMPL model, which has 24 joints",
        ),
        ("f", np.full((4, 3), 10**6), "f names vertices beyond"),
        ("v_template", "text", "v_template holds no numbers"),
    ],
)
def test_wrong_entries_are_refused(tmp_path: Path, key: str, value: Any, message: str) -> None:
    path = tmp_path / "x.pkl"
    path.write_bytes(pickle.dumps(smpl_entries() | {key: value}, protocol=2))
    with pytest.raises(AvatarError, match=message):
        load_smpl_model(path)
